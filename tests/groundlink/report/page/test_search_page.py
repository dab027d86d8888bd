# SPDX-License-Identifier: Apache-2.0
"""The page of a search shows failures, best points and coverage, and escapes what it shows."""

import dataclasses
import re

import pytest

from groundlink.report.page.search_page import MinimalFailure, SearchSummary, search_page
from groundlink.search.point_journal import PointOutcome, PointRow
from groundlink.search.sampler import EvenSampler
from groundlink.search.space import space

SPACE = space(
    [
        "route.speed_mps=0.2..1.5",
        "lidar.dropout=0.0..0.5",
        "lidar.datasheet=<b>,a$b$,c",
        "seed=1..5",
    ]
)
ORIGIN = {"route.speed_mps": 0.6, "lidar.dropout": 0.0, "lidar.datasheet": "<b>", "seed": 1}


def summary(count: int = 30, objective: str | None = "speed <m/s>") -> SearchSummary:
    sampler = EvenSampler(SPACE, 1)
    rows = [PointRow("scenario", 1, ORIGIN, PointOutcome("passed", "-", 0.6))]
    for number in range(1, count + 1):
        point = sampler.ask()
        assert point is not None
        speed = point["route.speed_mps"]
        verdict = "failed" if speed > 1.2 else "broken" if number == 7 else "passed"
        figure = speed if objective and verdict != "broken" else None
        outcome = PointOutcome(verdict, f"<script>alert({number})</script>", figure)
        rows.append(PointRow("search", number, point, outcome))
    return SearchSummary("<i>.yaml", SPACE, ORIGIN, rows, objective, True, None)


MINIMAL = MinimalFailure(
    {"route.speed_mps": 1.21}, PointOutcome("failed", "5 <m>"), "groundlink record 'a<b>.yaml'"
)


def test_page_needs_no_network_and_escapes_what_it_shows() -> None:
    page = search_page(dataclasses.replace(summary(), minimal=MINIMAL))
    assert "<script" not in page
    assert "<b>," not in page
    assert "<i>" not in page
    assert "5 &lt;m&gt;" in page
    loaded = re.findall(r'(?:src|href)="([^"]*)"', page)
    assert [link for link in loaded if not link.startswith(("#", "data:"))] == []
    assert page.count("<svg") == 3, "objective, histograms, pairs"


def test_failures_best_points_and_coverage_are_listed() -> None:
    whole = summary()
    page = search_page(dataclasses.replace(whole, minimal=MINIMAL))
    failed = sum(row.outcome.verdict == "failed" for row in whole.rows)
    assert f"{failed} of 31 points failed. Smallest failure: route.speed_mps=1.21." in page
    assert "It failed again in a second run" in page
    speeds = [row.outcome.objective for row in whole.best]
    assert speeds == sorted(speeds, reverse=True)
    assert f"<b>{speeds[0]:.5g}</b><span>best speed &lt;m/s&gt;</span>" in page
    assert "10 of 10" in page


@pytest.mark.parametrize("count", [0, 1, 5])
def test_search_without_objective_or_failure_has_a_page(count: int) -> None:
    few = summary(count, objective=None)
    rows = [row for row in few.rows if row.outcome.verdict != "failed"]
    page = search_page(dataclasses.replace(few, rows=rows))
    assert "No point failed." in page
    assert "Smallest failure" not in page
    assert "Objective" not in page


def test_failure_that_did_not_repeat_is_said() -> None:
    once = dataclasses.replace(MINIMAL, outcome=PointOutcome("passed", "-"))
    page = search_page(dataclasses.replace(summary(), minimal=once))
    assert "It did not fail again in a second run" in page
