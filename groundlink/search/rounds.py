# SPDX-License-Identifier: Apache-2.0
"""Order of a search: which points are evaluated when, so that it does not depend on speed."""

from collections.abc import Iterator
from typing import Protocol

from .point_journal import PointOutcome
from .sampler import Sampler
from .space import Point

SEARCH = "search"
"""Stage of the points that a sampler chose."""


class Evaluator(Protocol):
    """Evaluates points, several at a time."""

    def start(self, stage: str, number: int, values: Point) -> None:
        """Begin to evaluate a point, unless its outcome is known."""

    def result(self, values: Point) -> PointOutcome:
        """Wait for the outcome of a point that was started."""


def searched(
    sampler: Sampler, evaluator: Evaluator, budget: int, window: int, *, keep_going: bool
) -> Iterator[tuple[int, Point, PointOutcome]]:
    """Yield the points of a search with their numbers, from 1, and outcomes.

    Point n is chosen from the outcomes of the points up to n - `window`. So the points depend on
    the window, but not on which of them ends first. After the first failure no further point is
    chosen, unless `keep_going`; those that were begun are completed.
    """
    points: list[Point] = []
    told = 0
    is_over = False
    while True:
        while not is_over and len(points) < min(budget, told + window):
            point = sampler.ask()
            if point is None:
                is_over = True
            else:
                points.append(point)
                evaluator.start(SEARCH, len(points), point)
        if told == len(points):
            return
        outcome = evaluator.result(points[told])
        has_figure = outcome.verdict != "broken"
        sampler.tell(outcome.objective if has_figure else None)
        is_over |= outcome.verdict == "failed" and not keep_going
        told += 1
        yield told, points[told - 1], outcome
