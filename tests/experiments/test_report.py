# SPDX-License-Identifier: Apache-2.0
"""The page of a folder shows the tables and figures that are there, in the table's order."""

from dataclasses import replace
from pathlib import Path

from experiments.estimation.evaluation import write_csv, write_rows
from experiments.output.report import write_report

from .test_evaluation import ONE


def test_the_page_shows_what_is_there(tmp_path: Path) -> None:
    for name in ("tables", "figures"):
        (tmp_path / name).mkdir()
    write_rows(tmp_path / "tables" / "loss_arrived.csv", ["link"], [["1 % lost"]])
    write_csv(tmp_path / "tables" / "indoor_scans.csv", [replace(ONE, ate_m=0.0123)])
    for name in ("indoor_scans", "indoor_scans_map", "outdoor_mono"):
        (tmp_path / "figures" / f"{name}.png").touch()
    page = write_report(tmp_path).read_text(encoding="utf-8")
    shown = [
        *("## indoor_scans\n", "| 1.23 cm |", "(figures/indoor_scans.png)"),
        *("(figures/indoor_scans_map.png)", "## outdoor_mono\n", "(figures/outdoor_mono.png)"),
        *("## loss\n", "| 1 % lost |"),
    ]
    places = [page.index(text) for text in shown]
    assert places == sorted(places)
    assert page.count("\n## ") == 3
