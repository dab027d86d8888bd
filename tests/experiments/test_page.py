# SPDX-License-Identifier: Apache-2.0
"""The page of experiments has the tables that were measured, to the letter."""

import math
from dataclasses import replace
from pathlib import Path

import pytest

from experiments.estimation.evaluation import write_csv, write_rows
from experiments.output.page import KEPT, PAGE, table, text_of, with_table, write_report
from experiments.table import EXPERIMENTS

from .test_evaluation import ONE


def test_a_table_has_a_line_for_each_program_and_case() -> None:
    results = [replace(ONE, seed=s, ate_m=e) for s, e in enumerate((0.01, 0.5, 0.015), 1)]
    results += [replace(r, case="odometry alone", limit_m=0.0, ate_m=2.5) for r in results]
    lines = table("indoor", results).splitlines()
    assert lines[0] == "`python -m experiments indoor`"
    assert lines[4:] == [
        "| slam | 1.50 cm | 1.00 cm, 50.00 cm, 1.50 cm | 2.00 cm | 30.2 m | 2.00 cm | 12 s |",
        "| slam, odometry alone | 2.50 m | 2.50 m, 2.50 m, 2.50 m | 2.00 cm | 30.2 m | - | 12 s |",
    ]


def test_relative_errors_have_columns_where_there_are_any() -> None:
    far = replace(ONE, over_100_m=0.0012, limit_m=0.0, limit_over_100_m=0.01)
    head, _, *lines = table("indoor", [far, replace(ONE, case="short")]).splitlines()[2:]
    assert head.startswith("| program | ATE, median | of each seed | over 100 m, median | of each")
    assert lines == [
        "| slam | 1.00 cm | 1.00 cm | 0.12 % | 0.12 % | 2.00 cm | 30.2 m | 1 % over 100 m | 12 s |",
        "| slam, short | 1.00 cm | 1.00 cm | - | - | 2.00 cm | 30.2 m | 2.00 cm | 12 s |",
    ]


def test_lost_trajectory_is_marked() -> None:
    *_, line = table("indoor", [replace(ONE, ate_m=math.inf)]).splitlines()
    assert line.startswith("| slam | lost | lost | 2.00 cm |")


def test_only_what_is_between_the_marks_is_replaced() -> None:
    page = "a\n<!-- x -->\nold\n<!-- end of x -->\nb\n<!-- y -->\n<!-- end of y -->\n"
    assert with_table(page, "x", "new \\1") == page.replace("old", "new \\1")
    with pytest.raises(ValueError, match="marks <!-- z -->"):
        with_table(page, "z", "new")


def test_page_matches_the_tables() -> None:
    page = PAGE.read_text(encoding="utf-8")
    tables = sorted(KEPT.glob("*.csv"))
    assert tables
    for file in tables:
        assert any(file.stem.startswith(name) for name in EXPERIMENTS)
        assert with_table(page, file.stem, text_of(file)) == page, file.name


def test_a_table_of_another_kind_is_shown_as_it_stands(tmp_path: Path) -> None:
    file = tmp_path / "loss_arrived.csv"
    file.write_text('link,/points\n"1 % lost, repaired",40 of 40\n', encoding="utf-8")
    assert text_of(file).splitlines() == [
        "| link | /points |",
        "| --- | --- |",
        "| 1 % lost, repaired | 40 of 40 |",
    ]


def test_page_shows_available_results(tmp_path: Path) -> None:
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
