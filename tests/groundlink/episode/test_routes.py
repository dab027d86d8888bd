# SPDX-License-Identifier: Apache-2.0
"""Every kind of route is the line that its words say."""

from math import pi

import numpy as np
import pytest

from groundlink.episode.routes import line
from groundlink.scenario import route as routes

TRIANGLE = (
    routes.Waypoint(1.0, 0.0),
    routes.Waypoint(1.0, 1.0, speed_mps=0.2),
    routes.Waypoint(0.0, 1.0),
)

LENGTHS: list[tuple[routes.Route, float]] = [
    (routes.Circle(radius_m=2.0), 4 * pi),
    (routes.Circle(radius_m=2.0, laps=3, turn="right"), 12 * pi),
    (routes.FigureEight(radius_m=0.5), 2 * pi),
    (routes.Square(side_m=3.0, laps=2), 24.0),
    (routes.ThereAndBack(length_m=2.5), 5.0),
    (routes.Waypoints(points=TRIANGLE), 3.0),
    (routes.Waypoints(points=TRIANGLE, closed=True), 3.0 + 2**0.5),
    (routes.Waypoints(points=TRIANGLE, closed=True, laps=3), 1.0 + 3 * (2.0 + 2**0.5)),
]


@pytest.mark.parametrize(("route", "length_m"), LENGTHS)
def test_lengths(route: routes.Route, length_m: float) -> None:
    made = line(route, start_m=(0.0, 0.0), heading_rad=0.0)
    assert made.length_m == pytest.approx(length_m, rel=2e-4)
    assert len(made.speeds_mps) == len(made.points_m) - 1


@pytest.mark.parametrize("kind", routes.FIGURES)
def test_a_figure_begins_and_ends_where_the_vehicle_stands_and_goes_ahead(kind: str) -> None:
    route: routes.Route = routes.FIGURES[kind]()  # type: ignore[assignment]
    made = line(route, start_m=(3.0, -1.0), heading_rad=2.0)
    np.testing.assert_allclose(made.points_m[[0, -1]], [[3.0, -1.0]] * 2, atol=1e-9)
    first = made.points_m[1] - made.points_m[0]
    assert np.arctan2(first[1], first[0]) == pytest.approx(2.0, abs=0.02)


def test_a_circle_is_round_and_on_its_side() -> None:
    left = line(routes.Circle(radius_m=2.0), start_m=(0, 0), heading_rad=pi / 2).points_m
    np.testing.assert_allclose(np.linalg.norm(left - [-2.0, 0.0], axis=1), 2.0)
    right = line(
        routes.Circle(radius_m=2.0, turn="right"), start_m=(0, 0), heading_rad=0.0
    ).points_m
    np.testing.assert_allclose(np.linalg.norm(right - [0.0, -2.0], axis=1), 2.0)


def test_a_figure_eight_has_a_circle_on_each_side() -> None:
    made = line(routes.FigureEight(radius_m=1.0), start_m=(0, 0), heading_rad=0.0).points_m
    assert made[:, 1].max() == pytest.approx(2.0, abs=1e-3)
    assert made[:, 1].min() == pytest.approx(-2.0, abs=1e-3)
    assert made[20, 1] > 0


def test_waypoints_have_their_speeds_and_their_order() -> None:
    route = routes.Waypoints(points=TRIANGLE, closed=True, laps=2, speed_mps=0.5)
    made = line(route, start_m=(0.0, 0.0), heading_rad=1.0)
    a, b, c = [1, 0], [1, 1], [0, 1]
    np.testing.assert_allclose(made.points_m, [[0, 0], a, b, c, a, b, c, a])
    np.testing.assert_allclose(made.speeds_mps, [0.5, 0.2, 0.5, 0.5, 0.2, 0.5, 0.5])


def test_points_that_repeat_are_one() -> None:
    twice = routes.Waypoints(
        points=(routes.Waypoint(0.0, 0.0), routes.Waypoint(1.0, 0.0), routes.Waypoint(1.0, 0.0))
    )
    made = line(twice, start_m=(0.0, 0.0), heading_rad=0.0)
    np.testing.assert_allclose(made.points_m, [[0, 0], [1, 0]])
    assert len(made.speeds_mps) == 1
