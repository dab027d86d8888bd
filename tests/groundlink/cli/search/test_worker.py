# SPDX-License-Identifier: Apache-2.0
"""Workers of a search: who may join, and what a search takes from them."""

from pathlib import Path

import pytest

from groundlink.cli.search import worker
from groundlink.cli.search.evaluation import EvaluationRequest
from groundlink.cli.search.point_processes import PointProcesses
from groundlink.cli.search.result_folder import content_of
from groundlink.core import VERSION
from groundlink.core.errors import UserError
from groundlink.loader import load
from groundlink.search.point_journal import PointJournal, PointOutcome, key
from groundlink.search.point_leases import WorkerReport

DETERMINED_BY = {
    "groundlink": VERSION,
    "scenario": "indoor_lab_tour",
    "content of the scenario": content_of(load("indoor_lab_tour")),
}
PASSED = PointOutcome("passed", "-")


def test_worker_with_the_same_scenario_joins() -> None:
    worker.check_host(DETERMINED_BY)


@pytest.mark.parametrize("name", ["groundlink", "content of the scenario"])
def test_worker_with_another_scenario_or_version_ends(name: str) -> None:
    with pytest.raises(UserError, match=f"{name} is .* here, and other at the search"):
        worker.check_host({**DETERMINED_BY, name: "other"})


def test_search_takes_outcomes_of_its_own_points_once(tmp_path: Path) -> None:
    journal = PointJournal(tmp_path / "journal.jsonl", DETERMINED_BY)
    request = EvaluationRequest("indoor_lab_tour", "", "1")
    said: list[str] = []
    mine, one = journal.identity, key({"seed": 1})
    with PointProcesses(journal, request, lambda values: [], 0, tmp_path, said.append) as points:
        points.start("search", 1, {"seed": 1})

        def start(search: str, outcome: PointOutcome | None = None) -> list[str]:
            done = {one: outcome} if outcome else {}
            report = WorkerReport("host:1", search, [], done, 1)
            return [*points.exchange(report).start]

        assert start("") == start("another", PASSED) == []
        assert start(mine) == [one]
        assert start(mine, PASSED) == []
        assert points.result({"seed": 1}) == PASSED
        assert start(mine, PointOutcome("failed", "late")) == []
        points.start("search", 2, {"seed": 2})
        assert start(mine) == [key({"seed": 2})]
        assert points.result({"seed": 1}) == PASSED
    assert [row.values for row in journal.rows] == [{"seed": 1}]
    assert said == ["worker host:1 joined"]
    journal.close()
