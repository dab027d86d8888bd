# SPDX-License-Identifier: Apache-2.0
"""The driver on the simulated rover: how near it stays to its line, and that it ends."""

from collections.abc import Sequence
from math import atan2, cos, hypot, inf, pi, radians, sin

import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.core.clock import TICK_NANOS
from groundlink.episode.routes import Line, line
from groundlink.loader import load
from groundlink.loader.document import read
from groundlink.loader.scenario_files import SHIPPED
from groundlink.loader.validation_errors import convert
from groundlink.messages.base import Command
from groundlink.scenario import Scenario
from groundlink.scenario.route import (
    COMMAND_AHEAD_TICKS,
    DRIVER_PERIOD_TICKS,
    Circle,
    FigureEight,
    Route,
    Square,
    ThereAndBack,
)
from groundlink.scenario.schema import Placement
from groundlink.scenario.vehicle import VehicleModel
from groundlink.scene.build import solids
from groundlink.world.solids import Box, Solid
from services.driver.pure_pursuit import PurePursuitFollower
from services.physics.simulation.simulation import Simulation

PERIOD_S = 0.02


def distance_m(points: np.ndarray, place: np.ndarray) -> float:
    """Return how far a place is from a line."""
    moves = np.diff(points, axis=0)
    share = np.sum((place - points[:-1]) * moves, axis=1) / np.sum(moves**2, axis=1)
    feet = points[:-1] + np.clip(share, 0, 1)[:, None] * moves
    return float(np.linalg.norm(place - feet, axis=1).min())


def drive(
    scenario: Scenario,
    made: Line,
    seconds: float,
    *,
    floor: Sequence[Solid] = (),
    least_radius_m: float = 0.0,
) -> np.ndarray:
    """Return x, y, yaw at each command until the line is driven."""
    follower, rows = PurePursuitFollower(made, least_radius_m=least_radius_m), []
    floor = floor or [s for s in solids(scenario) if s.name == "room_floor"]
    with Simulation(scenario, floor) as it:
        while not follower.finished:
            assert it.tick < seconds * 400, "the end is not reached"
            if it.tick % DRIVER_PERIOD_TICKS == 0:
                x, y, _, qx, qy, qz, qw = it.vehicle_states()["rover"].poses()[0].tolist()
                yaw = atan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz))
                linear, angular = follower.twist(x, y, yaw)
                stamp = it.sim_nanos + COMMAND_AHEAD_TICKS * TICK_NANOS
                it.command("rover", Command(stamp, (linear, 0.0, 0.0), (0.0, 0.0, angular)))
                rows.append((x, y, yaw))
            it.step()
    return np.array(rows)


@pytest.mark.parametrize(
    ("route", "within_m"),
    [
        (Circle(radius_m=1.0, speed_mps=0.6), 0.03),
        (FigureEight(radius_m=0.8, speed_mps=0.5, turn="right"), 0.06),
        (Square(side_m=1.5, speed_mps=0.8), 0.03),
        (ThereAndBack(length_m=2.0, speed_mps=1.0), 0.03),
    ],
)
def test_figures_are_driven_on_the_line_to_their_end(route: Route, within_m: float) -> None:
    lab = load(SHIPPED / "indoor_lab.yaml")
    start = Placement(x_m=0.5, y_m=-0.3, yaw_deg=70.0)
    scenario = replace(lab, vehicles=(replace(lab.vehicles[0], placement=start),))
    made = line(route, start_m=(0.5, -0.3), heading_rad=radians(70.0))
    driven = drive(scenario, made, 2.5 * made.length_m / route.speed_mps + 20)
    apart = [distance_m(made.points_m, place) for place in driven[:, :2]]
    assert max(apart) < within_m
    assert hypot(*(driven[-1, :2] - made.points_m[-1])) < 0.03
    gone = np.linalg.norm(np.diff(driven[:, :2], axis=0), axis=1).sum()
    assert gone == pytest.approx(made.length_m, rel=0.05)


def rolled(
    follower: PurePursuitFollower, pose: tuple[float, float, float], turns_radps2: float = inf
) -> list[tuple[float, float]]:
    """Return where an ideal vehicle comes from a pose until the line is driven."""
    x, y, yaw = pose
    places, rate = [], 0.0
    for _ in range(10_000):
        linear, angular = follower.twist(x, y, yaw)
        if follower.finished:
            return places
        most = turns_radps2 * PERIOD_S
        rate += max(-most, min(most, angular - rate))
        yaw += rate * PERIOD_S
        x, y = x + linear * cos(yaw) * PERIOD_S, y + linear * sin(yaw) * PERIOD_S
        places.append((x, y))
    raise AssertionError("the end is not reached")


STRAIGHT = Line(np.array([[0.0, 0.0], [4.0, 0.0]]), np.array([0.5]))


BENDS = np.radians([0.0, 23.0, 46.0, 69.0])
WINDING = Line(
    np.cumsum([(0.0, 0.0), *(10 * np.array([cos(a), sin(a)]) for a in BENDS)], axis=0),
    np.full(4, 2.4),
)


def test_what_is_slow_to_turn_does_not_swing_about_the_line() -> None:
    places = np.array(rolled(PurePursuitFollower(WINDING, turns_radps2=1.0), (0.0, 0.0, 0.0), 1.0))
    assert max(distance_m(WINDING.points_m, place) for place in places) < 0.35
    # All the way it comes ahead, so it is as fast as it is asked to be.
    assert len(places) < 1.1 * WINDING.length_m / 2.4 / PERIOD_S + 150


def test_what_is_slow_to_turn_does_not_turn_too_far_on_the_spot() -> None:
    corner = Line(np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 3.0]]), np.array([0.8, 0.8]))
    places = rolled(PurePursuitFollower(corner, turns_radps2=0.5), (0.0, 0.0, 0.0), 0.5)
    assert max(distance_m(corner.points_m, np.array(place)) for place in places) < 0.05


@pytest.mark.parametrize("pose", [(0, 1, 0), (0, -0.5, pi), (-1, 0, -2), (0, 0, pi / 2)])
def test_a_vehicle_off_the_line_comes_back_to_it(pose: tuple[float, float, float]) -> None:
    places = rolled(PurePursuitFollower(STRAIGHT), pose)
    assert places[-1] == pytest.approx((4.0, 0.0), abs=0.02)
    assert all(abs(y) < 0.02 for x, y in places if x > 2.5)


def test_one_that_comes_later_goes_on_from_the_nearest_place() -> None:
    places = rolled(PurePursuitFollower(STRAIGHT), (2.0, 0.1, 0.0))
    assert min(x for x, _ in places) >= 2.0


def test_where_the_line_crosses_itself_it_goes_on_as_it_came() -> None:
    made = line(FigureEight(radius_m=1.0), start_m=(0.0, 0.0), heading_rad=0.0)
    places = np.array(rolled(PurePursuitFollower(made), (0.0, 0.0, 0.0)))
    half = len(places) // 2
    assert places[:half, 1].min() > -0.1
    assert places[half:, 1].max() < 0.1


def test_speed_falls_towards_the_end_and_is_zero_after_it() -> None:
    follower = PurePursuitFollower(STRAIGHT)
    speeds = [follower.twist(x, 0.0, 0.0)[0] for x in (3.0, 3.5, 3.9, 3.99)]
    assert speeds[0] == speeds[1] == 0.5
    assert 0 < speeds[3] < speeds[2] < 0.5
    assert follower.twist(4.01, 0.0, 0.0) == (0.0, 0.0)
    assert follower.finished


def test_a_line_without_length_is_driven_at_once() -> None:
    follower = PurePursuitFollower(Line(np.zeros((1, 2)), np.zeros(0)))
    assert follower.twist(1.0, 2.0, 3.0) == (0.0, 0.0)
    assert follower.finished


def test_the_curvature_is_that_of_the_arc_to_the_point_ahead() -> None:
    """Coulter: a goal at (ahead, left) lies on a circle of curvature 2 left / distance^2."""
    follower = PurePursuitFollower(STRAIGHT)
    assert follower.twist(1.0, 0.0, 0.0) == (0.5, 0.0)
    linear, angular = follower.twist(1.0, 0.1, 0.0)
    assert linear == 0.5
    left, ahead = -0.1, 0.25 + 0.3 * 0.5
    assert angular < 0
    radius = linear / -angular
    assert hypot(ahead, radius + left) == pytest.approx(radius)


@pytest.mark.parametrize(
    ("route", "within_m"),
    [
        (Circle(radius_m=8.0, speed_mps=3.0), 0.6),
        (FigureEight(radius_m=8.0, speed_mps=3.0), 1.0),
        (Square(side_m=20.0, speed_mps=4.0), 3.0),
    ],
)
def test_a_car_follows_as_narrowly_as_it_steers(route: Route, within_m: float) -> None:
    lab = load(SHIPPED / "indoor_lab.yaml")
    car = convert(read(SHIPPED / "vehicles" / "car.yaml"), VehicleModel)
    vehicle = replace(lab.vehicles[0], model=car, placement=Placement())
    floor = Solid("room_floor", Box(size_m=(200.0, 200.0, 1.0)), "linoleum", (0.0, 0.0, -0.5))
    scenario = replace(lab, vehicles=(vehicle,))
    made = line(route, start_m=(0.0, 0.0), heading_rad=0.0)
    seconds = 1.5 * made.length_m / route.speed_mps + 20
    driven = drive(scenario, made, seconds, floor=[floor], least_radius_m=car.least_radius_m)
    apart = [distance_m(made.points_m, place) for place in driven[:, :2]]
    assert max(apart) < within_m
    assert hypot(*(driven[-1, :2] - made.points_m[-1])) < 1.0
