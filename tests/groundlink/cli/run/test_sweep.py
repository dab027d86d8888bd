# SPDX-License-Identifier: Apache-2.0
"""A sweep records each combination once, and tables what differs."""

import csv
import json
import shutil
from pathlib import Path

import pytest

from groundlink.__main__ import main as groundlink
from groundlink.cli.run import sweep as module
from groundlink.cli.run.cases import Case
from groundlink.scenario import Scenario

ROOT = Path(__file__).parents[4]
RECORDING = ROOT / "tests" / "compatibility" / "every_kind.mcap"


@pytest.fixture
def recorded(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The changes of each run, or the drive on which its sensors are simulated.

    Each gives the same recording, but a seed of 3 keeps no rate.
    """
    cases: list[str] = []

    def record(scenario: str, case: Case, to: Path, duration: str | None) -> int:
        cases.append(" ".join(change.text for change in case))
        shutil.copy(RECORDING, to)
        return 1 if "seed=3" in cases[-1] else 0

    def record_again(drive: module._Drive, scenario: Scenario, to: Path) -> int:
        cases.append(f"{to.stem} on {drive.number}")
        shutil.copy(drive.recording, to)
        return 0

    monkeypatch.setattr(module, "record_case", record)
    monkeypatch.setattr(module._Drive, "record", record_again)
    return cases


def test_each_combination_is_recorded_once(
    recorded: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--set", "seed=1,2", "--set", "lidar.dropout=0,0.5", "--out", str(tmp_path / "all")]
    assert groundlink(["sweep", "indoor_lab", *words, "--check", "basename"]) == 0
    assert recorded == [
        "seed=1 lidar.dropout=0",
        "2 on 1",
        "seed=2 lidar.dropout=0",
        "4 on 3",
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


@pytest.mark.parametrize(
    ("words", "runs"),
    [
        (["--set", "lidar.dropout=0,0.1,0.2"], ["lidar.dropout=0", "2 on 1", "3 on 1"]),
        (["--set", "world.weather.rain_mm_per_h=1,5"], ["world.weather.rain_mm_per_h=1", "2 on 1"]),
        (["--set", "rover.placement.x_m=0,1"], ["rover.placement.x_m=0", "rover.placement.x_m=1"]),
        (["--set", "time.mode=fast,lockstep"], ['time.mode="fast"', 'time.mode="lockstep"']),
        (
            ["--set", "lidar.dropout=0,0.1", "--set", "rover.route.speed_mps=0.3,0.5"],
            [
                "lidar.dropout=0 rover.route.speed_mps=0.3",
                "lidar.dropout=0 rover.route.speed_mps=0.5",
                "3 on 1",
                "4 on 2",
            ],
        ),
    ],
)
def test_a_drive_is_recorded_once(words: list[str], runs: list[str], recorded: list[str]) -> None:
    assert groundlink(["sweep", "indoor_lab_tour", *words]) == 0
    assert recorded == runs


def test_no_drive_is_taken_from_a_run_that_failed(recorded: list[str]) -> None:
    words = ["--set", "seed=3", "--set", "lidar.dropout=0,0.1"]
    assert groundlink(["sweep", "indoor_lab", *words]) == 1
    assert recorded == ["seed=3 lidar.dropout=0", "seed=3 lidar.dropout=0.1"]


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
