# SPDX-License-Identifier: Apache-2.0
"""A sweep records each combination once, and tables what differs."""

import argparse
import csv
import json
import shutil
from pathlib import Path

import pytest

from groundlink.__main__ import main as groundlink
from groundlink.cli.run import sweep as module
from groundlink.loader.overrides import FieldChange

ROOT = Path(__file__).parents[4]
RECORDING = ROOT / "tests" / "compatibility" / "every_kind.mcap"


@pytest.fixture
def recorded(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The changes of each run; each gives the same recording, but a seed of 3 keeps no rate."""
    cases: list[str] = []

    def record(options: argparse.Namespace, case: tuple[FieldChange, ...], to: Path) -> int:
        cases.append(" ".join(change.text for change in case))
        shutil.copy(RECORDING, to)
        return 1 if "seed=3" in cases[-1] else 0

    monkeypatch.setattr(module, "_record", record)
    return cases


def test_each_combination_is_recorded_once(
    recorded: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--set", "seed=1,2", "--set", "lidar.dropout=0,0.5", "--out", str(tmp_path / "all")]
    assert groundlink(["sweep", "indoor_lab", *words, "--check", "basename"]) == 0
    assert recorded == [
        "seed=1 lidar.dropout=0",
        "seed=1 lidar.dropout=0.5",
        "seed=2 lidar.dropout=0",
        "seed=2 lidar.dropout=0.5",
    ]
    with (tmp_path / "all" / "table.csv").open(newline="") as opened:
        rows = list(csv.DictReader(opened))
    assert [(row["seed"], row["lidar.dropout"], row["check"]) for row in rows] == [
        ("1", "0", "1.mcap"),
        ("1", "0.5", "2.mcap"),
        ("2", "0", "3.mcap"),
        ("2", "0.5", "4.mcap"),
    ]
    assert all((tmp_path / "all" / row["check"]).exists() for row in rows)
    assert float(rows[0]["driven m"]) > 0
    table = capsys.readouterr().out
    assert "lidar.dropout" in table
    assert "driven m" not in table, "it does not differ"


def test_rows_are_printed_as_json(recorded: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert groundlink(["sweep", "indoor_lab", "--set", "seed=2,3", "--json"]) == 1
    printed = json.loads(capsys.readouterr().out)
    assert [row["seed"] for row in printed["runs"]] == [2, 3]
    assert printed["runs"][0]["driven m"] > 0
    assert printed["failed"] == ["seed=3"]


def test_run_or_check_that_fails_is_named(
    recorded: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert groundlink(["sweep", "indoor_lab", "--set", "seed=2,3,4"]) == 1
    assert capsys.readouterr().out.splitlines()[-1] == "failed: seed=3"
    check = "sh -c 'echo $(basename $0); test $(basename $0) != 1.mcap'"
    assert groundlink(["sweep", "indoor_lab", "--set", "seed=1,2", "--check", check]) == 1
    shown = capsys.readouterr().out
    assert shown.splitlines()[-1] == "failed: seed=1"
    assert "2.mcap" in shown


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--set", "lidar.dropout"], "--set lidar.dropout: expected FIELD=VALUE"),
        (["--set", "lidar.dropout=0,2"], "`dropout`: expected `float` <= 1.0"),
        (["--set", "seed=1", "--out", "."], "--out .: file exists"),
        (["--vary", "scanner.mount=[lidar]", "--duration", "3"], "--duration apply to scenarios"),
    ],
)
def test_mistake_is_one_line_before_the_first_run(
    words: list[str], line: str, recorded: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert groundlink(["sweep", "indoor_lab", *words]) == 2
    error = capsys.readouterr().err
    assert line in error.replace("vehicles[0].sensors[0].", "")
    assert error.count("\n") == 1
    assert recorded == []
