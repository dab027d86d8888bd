# SPDX-License-Identifier: Apache-2.0
"""Samplers choose every point once, and the same points for the same seed and results."""

import numpy as np
import pytest

from groundlink.search.coverage import coverage
from groundlink.search.sampler import EvenSampler, OptunaSampler, Sampler
from groundlink.search.space import Point, space

SPACE = space(["a.x=0.0..1.0", "a.y=-5..5", "a.z=red,green,blue"])


def distance(point: Point) -> float:
    """Return the distance from x = 0.7, y = 3, blue."""
    return abs(point["a.x"] - 0.7) + abs(point["a.y"] - 3) / 10 + (point["a.z"] != "blue")


def chosen(sampler: Sampler, count: int) -> list[Point]:
    points = []
    for _ in range(count):
        point = sampler.ask()
        assert point is not None
        points.append(point)
        sampler.tell(distance(point))
    return points


def test_even_points_visit_all_bins_early() -> None:
    points = chosen(EvenSampler(SPACE, seed=3), 40)
    assert [coverage(field, points).share for field in SPACE.fields] == [1.0, 1.0, 1.0]
    x = np.sort([point["a.x"] for point in points])
    assert np.diff(x).max() < 3 / 40


def test_optuna_comes_closer_than_even_points() -> None:
    best = {
        kind: min(distance(point) for point in chosen(sampler, 60))
        for kind, sampler in (
            ("even", EvenSampler(SPACE, seed=1)),
            ("guided", OptunaSampler(SPACE, seed=1, maximize=False)),
        )
    }
    assert best["guided"] < best["even"]


def test_maximize_is_the_opposite() -> None:
    farthest = OptunaSampler(SPACE, seed=1, maximize=True)
    assert max(map(distance, chosen(farthest, 50))) > 2.2


@pytest.mark.parametrize("seed", [0, 1])
def test_same_seed_and_results_give_the_same_points(seed: int) -> None:
    def points() -> list[Point]:
        return chosen(OptunaSampler(SPACE, seed, maximize=False), 30)

    assert points() == points()
    assert points() != chosen(OptunaSampler(SPACE, seed + 1, maximize=False), 30)


SMALL = space(["a.x=1..5", "a.z=red,green,blue"])


@pytest.mark.parametrize("guided", [False, True])
def test_every_point_of_a_small_space_is_chosen_once(guided: bool) -> None:
    sampler: Sampler = EvenSampler(SMALL, seed=1)
    if guided:
        sampler = OptunaSampler(SMALL, seed=1, maximize=False)
    points = []
    while (point := sampler.ask()) is not None:
        points.append(point)
        sampler.tell(None if len(points) % 4 == 0 else float(point["a.x"]))
    assert len(points) == SMALL.size == 15
    assert len({tuple(point.values()) for point in points}) == 15
