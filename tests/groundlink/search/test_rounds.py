# SPDX-License-Identifier: Apache-2.0
"""The points of a search depend on seed and window, not on which evaluation ends first."""

import pytest

from groundlink.search.point_journal import PointOutcome
from groundlink.search.rounds import searched
from groundlink.search.sampler import EvenSampler, OptunaSampler
from groundlink.search.space import Point, space

SPACE = space(["a.x=0.0..1.0", "a.y=0.0..1.0"])


class Instantly:
    """Evaluates a point when it is started; fails beyond x = 0.8."""

    def __init__(self, known: dict[str, PointOutcome] | None = None) -> None:
        self.outcomes = dict(known or {})
        self.run: list[Point] = []
        self.most = 0
        self._open = 0

    def start(self, stage: str, number: int, values: Point) -> None:
        assert stage == "search"
        self._open += 1
        self.most = max(self.most, self._open)
        if str(values) not in self.outcomes:
            self.run.append(values)
            failed = values["a.x"] > 0.8
            verdict = "broken" if values["a.y"] < 0.05 else "failed" if failed else "passed"
            self.outcomes[str(values)] = PointOutcome(verdict, "-", 1 - values["a.x"])

    def result(self, values: Point) -> PointOutcome:
        self._open -= 1
        return self.outcomes[str(values)]


def points(evaluator: Instantly, *, budget: int = 40, window: int = 1, keep_going: bool = True):
    sampler = OptunaSampler(SPACE, 1, maximize=False)
    return [
        (number, point)
        for number, point, _ in searched(sampler, evaluator, budget, window, keep_going=keep_going)
    ]


@pytest.mark.parametrize("window", [1, 3])
def test_continued_search_has_the_points_of_a_whole_one(window: int) -> None:
    whole = Instantly()
    expected = points(whole, window=window)
    assert [number for number, _ in expected] == list(range(1, 41))
    assert whole.most == window
    half = dict(list(whole.outcomes.items())[:17])
    rest = Instantly(half)
    assert points(rest, window=window) == expected
    assert rest.run == whole.run[17:]
    assert points(Instantly(), budget=20, window=window) == expected[:20]


def test_search_ends_after_the_first_failure() -> None:
    evaluator = Instantly()
    found = points(evaluator, keep_going=False)
    verdicts = [outcome.verdict for outcome in evaluator.outcomes.values()]
    assert verdicts.index("failed") == len(found) - 1 < 39
    several = Instantly()
    assert len(points(several, window=4, keep_going=False)) == len(several.run)
    verdicts = [outcome.verdict for outcome in several.outcomes.values()]
    assert verdicts.index("failed") == len(verdicts) - 4, "those that were begun are completed"


def test_small_space_ends_before_the_budget() -> None:
    small = space(["a.x=0,0.5", "a.y=0.5,1"])
    found = list(searched(EvenSampler(small, 1), Instantly(), 100, 2, keep_going=True))
    assert len(found) == 4
