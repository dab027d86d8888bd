# SPDX-License-Identifier: Apache-2.0
"""A search finds a failure, shrinks it, continues after an interruption, and writes its results."""

import csv
import json
from pathlib import Path
from typing import Any

import pytest
from pyarrow import parquet

from groundlink.__main__ import main as groundlink
from groundlink.loader import load
from groundlink.search.point_journal import PointOutcome

from .conftest import Evaluations

VARY = [
    *("--vary", "route.speed_mps=0.2..1.4"),
    *("--vary", "lidar.dropout=0.0..0.5"),
    *("--vary", "lidar.datasheet=vlp16,vlp32c"),
]


def fast_and_blind(changes: dict[str, Any]) -> PointOutcome:
    """Fail at 1 m/s and more with a dropout of 0.1 and more."""
    speed, dropout = changes.get("route.speed_mps", 0.6), changes.get("lidar.dropout", 0.0)
    verdict = "failed" if speed >= 1.0 and dropout >= 0.1 else "passed"
    return PointOutcome(verdict, f"{speed} m/s", 1.4 - speed, {"top speed m/s": speed})


def search(out: Path, *words: str, budget: int = 16) -> int:
    return groundlink(
        ["search", "indoor_lab_tour", *VARY, "--budget", str(budget), "--out", str(out), *words]
    )


@pytest.mark.parametrize("words", [(), ("--objective", "top speed m/s", "--maximize")])
def test_failure_is_found_shrunk_and_repeated(
    words: tuple[str, ...],
    evaluations: Evaluations,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    evaluations.model = fast_and_blind
    out = tmp_path / "out"

    def outcome(changes: dict[str, Any]) -> PointOutcome:
        if evaluations.requests[-1].scenario == str(out / "minimal.yaml"):
            return PointOutcome("failed", "again")
        return fast_and_blind(changes)

    evaluations.model = outcome
    assert search(out, "--json", *words) == 1
    printed = json.loads(capsys.readouterr().out)
    point = printed["minimal"]["point"]
    assert point.keys() == {"route.speed_mps", "lidar.dropout"}
    assert 1.0 <= point["route.speed_mps"] <= 1.0 + 0.8 / 64
    assert 0.1 <= point["lidar.dropout"] <= 0.1 + 0.5 / 64
    assert printed["minimal"]["outcome"] == {
        "verdict": "failed",
        "text": "again",
        "objective": None,
        "figures": {},
    }
    minimal = load(out / "minimal.yaml")
    lidar = minimal.vehicles[0].sensors[0]
    assert lidar.dropout == point["lidar.dropout"]
    last = evaluations.requests[-1]
    assert (last.scenario, last.changes) == (str(out / "minimal.yaml"), [])
    assert last.recording == str(out / "minimal.mcap")
    assert sorted(file.name for file in out.iterdir()) == [
        "journal.jsonl",
        "minimal.yaml",
        "points.csv",
        "points.parquet",
        "search.html",
    ]


def test_every_point_is_in_the_tables_with_all_fields(
    evaluations: Evaluations, tmp_path: Path
) -> None:
    evaluations.model = fast_and_blind
    search(tmp_path / "out", "--keep-going", budget=12)
    table = parquet.read_table(tmp_path / "out" / "points.parquet").to_pylist()
    with (tmp_path / "out" / "points.csv").open(newline="", encoding="utf-8") as opened:
        rows = list(csv.DictReader(opened))
    assert [(row["stage"], int(row["number"])) for row in rows] == [
        (row["stage"], row["number"]) for row in table
    ]
    assert [row["stage"] for row in table][:13] == ["scenario", *["search"] * 12]
    assert table[0]["route.speed_mps"] == 0.6
    assert table[0]["lidar.datasheet"] == "sensors/vlp16_paper.yaml"
    for row in table:
        assert (row["verdict"] == "failed") == (
            row["route.speed_mps"] >= 1.0 and row["lidar.dropout"] >= 0.1
        )
        assert row["top speed m/s"] == row["route.speed_mps"]


@pytest.mark.parametrize(("jobs", "guided"), [("3", False), ("1", True)])
def test_interrupted_search_continues_without_losing_or_repeating_a_point(
    jobs: str, guided: bool, evaluations: Evaluations, tmp_path: Path
) -> None:
    words = ["--jobs", jobs, "--keep-going"]
    words += ["--objective", "top speed m/s"] if guided else []
    evaluations.model = fast_and_blind
    search(tmp_path / "whole", *words)
    whole = evaluations.changes
    for number in (9, len(whole) - 1):
        evaluations.requests.clear()
        out = tmp_path / str(number)
        evaluations.outcomes, evaluations.interrupt_at = 0, number
        assert search(out, *words) == 130
        begun = evaluations.changes
        known = (out / "journal.jsonl").read_text().count("\n") - 1
        evaluations.interrupt_at = 0
        assert search(out, *words) == 1
        assert known == number - 1
        assert len(begun) - known <= int(jobs)
        assert [*begun[:known], *evaluations.changes[len(begun) :]] == whole
        for name in ("points.csv", "minimal.yaml"):
            assert (out / name).read_text() == (tmp_path / "whole" / name).read_text()


def test_finished_search_runs_nothing_and_a_larger_budget_only_what_is_new(
    evaluations: Evaluations, tmp_path: Path
) -> None:
    search(tmp_path / "out", budget=10)
    assert len(evaluations.requests) == 11
    search(tmp_path / "out", budget=10)
    assert len(evaluations.requests) == 11
    search(tmp_path / "out", budget=15)
    assert len(evaluations.requests) == 16
    assert len({str(changes) for changes in evaluations.changes}) == 16


def test_scenario_that_fails_unchanged_ends_the_search(
    evaluations: Evaluations, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    evaluations.model = lambda changes: PointOutcome("failed", "stuck")
    assert search(tmp_path / "out") == 1
    assert len(evaluations.requests) == 1
    assert "the scenario fails without a change" in capsys.readouterr().out


def test_broken_points_are_neither_failures_nor_the_end(
    evaluations: Evaluations, tmp_path: Path
) -> None:
    evaluations.model = lambda changes: PointOutcome(
        "broken" if changes.get("lidar.dropout", 0) > 0.2 else "passed", "no room"
    )
    assert search(tmp_path / "out", budget=8) == 0
    assert len(evaluations.requests) == 9


def test_mistake_in_the_objective_leaves_an_empty_folder(
    evaluations: Evaluations, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    evaluations.model = lambda changes: PointOutcome("passed", "-", None, {"driven m": 1.0})
    assert search(tmp_path / "out", "--objective", "drven m") == 2
    error = capsys.readouterr().err
    assert "--objective drven m: neither a key figure nor" in error
    assert "did you mean `driven m`?" in error
    assert list((tmp_path / "out").iterdir()) == []
    evaluations.model = lambda changes: PointOutcome("broken", "no room to start")
    assert search(tmp_path / "out") == 2
    assert "no result without a change: no room to start" in capsys.readouterr().err


def test_other_command_line_on_the_same_folder_is_refused(
    evaluations: Evaluations, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    search(tmp_path / "out", budget=3)
    assert search(tmp_path / "out", "--seed", "2", budget=3) == 2
    error = capsys.readouterr().err
    assert "--seed is 1, expected 2. Fix: repeat its command line" in error
    assert error.count("\n") == 1
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "a.txt").write_text("mine")
    assert search(tmp_path / "notes") == 2
    assert "exists without journal.jsonl" in capsys.readouterr().err
