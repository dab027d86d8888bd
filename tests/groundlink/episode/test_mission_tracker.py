# SPDX-License-Identifier: Apache-2.0
"""What a vehicle did is judged as somebody who looks on would; trajectories are made up."""

from collections.abc import Callable, Sequence
from math import cos, inf, nan, pi, sin

import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.core.frames import quaternion_from_rpy
from groundlink.episode.mission import (
    DRIVING,
    DROWNED,
    FALLING,
    LEFT,
    STANDING,
    STUCK,
    TIPPED,
    Mission,
)
from groundlink.episode.mission_tracker import MissionTracker, wheels_twist, world_box
from groundlink.episode.routes import Leg, line
from groundlink.loader import load
from groundlink.loader.document import read
from groundlink.loader.scenario_files import SHIPPED
from groundlink.loader.validation_errors import convert
from groundlink.scenario.route import Circle, FigureEight, Route, ThereAndBack
from groundlink.scenario.running_gear import SideSteered
from groundlink.scenario.schema import Placement, Scenario, Vehicle
from groundlink.scenario.vehicle import VehicleModel

Pose = tuple[float, float, float, float, float, float]
"""x, y, z (m), roll, pitch, yaw (rad)."""

Command = tuple[float, float] | None

BOX = np.array([-20.0, -20.0, -1.0]), np.array([20.0, 20.0, 3.0])
REST: Pose = (0.0, 0.0, 0.17, 0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def lab() -> Scenario:
    return load("indoor_lab_tour")


@pytest.fixture(scope="module")
def rover(lab: Scenario) -> Vehicle:
    return replace(lab.vehicles[0], route=None, placement=Placement())


def judged(
    vehicle: Vehicle,
    seconds: float,
    pose: Callable[[float], Pose],
    command: Callable[[float], Command] = lambda t: None,
    *,
    touching: Sequence[str] = (),
    hz: int = 50,
    from_s: float = 0.0,
) -> Mission:
    """Return the verdict on a trajectory; commands are sent 20 times a second."""
    tracker = MissionTracker(vehicle, BOX)
    for i in range(round(from_s * hz), round(seconds * hz) + 1):
        t = i / hz
        if i % (hz // 20 or 1) == 0 and (asked := command(t)) is not None:
            tracker.commanded(t, *asked)
        if touching:
            tracker.touched(t, touching)
        x, y, z, *turns = pose(t)
        tracker.moved(t, (x, y, z), quaternion_from_rpy(*turns))
    return tracker.mission()


def stands(t: float) -> Pose:
    return REST


def ahead(speed: float) -> Callable[[float], Pose]:
    return lambda t: (speed * t, *REST[1:])


def always(speed: float, turn: float = 0.0) -> Callable[[float], Command]:
    return lambda t: (speed, turn)


def test_a_rover_that_stands_still_for_17_of_20_seconds_is_stuck(rover: Vehicle) -> None:
    """Once its page was green."""
    it = judged(rover, 20.0, lambda t: (0.5 * min(t, 3.0), *REST[1:]), always(0.5))
    assert it.state == STUCK
    assert it.ending
    assert it.ending.begin_seconds == pytest.approx(3.0, abs=0.31)
    assert it.stuck_seconds == pytest.approx(17.0, abs=0.31)
    assert it.speed_share == pytest.approx(0.15, abs=0.01)
    failure = it.failure()
    assert failure
    assert failure.startswith("rover: stuck at x 1.")
    assert "Fix: check torque" in failure
    assert it.problems() == [failure, "rover drove 1.5 of 10.0 m commanded"]


def test_a_vehicle_whose_motors_drown_ends_there(rover: Vehicle) -> None:
    tracker = MissionTracker(rover, BOX)
    for i in range(60):
        tracker.commanded(i / 10, 0.5, 0.0)
        if i == 20:
            tracker.drowned()
        tracker.moved(i / 10, (0.05 * min(i, 20), 0.0, 0.17), (0.0, 0.0, 0.0, 1.0))
    it = tracker.mission()
    assert it.state == DROWNED
    failure = it.failure()
    assert failure
    assert failure.startswith("rover: drowned at x 1.00, y 0.00 m since 2.0 s")
    assert "wading.depth_m" in failure


def test_nobody_commands_nobody_is_stuck(rover: Vehicle) -> None:
    it = judged(rover, 20.0, stands)
    assert (it.state, it.problems(), it.speed_share) == (STANDING, [], None)


def test_who_commands_standstill_gets_it(rover: Vehicle) -> None:
    assert judged(rover, 20.0, stands, always(0.0)).state == STANDING


def test_a_controller_that_hunts_around_its_goal_is_not_stuck(rover: Vehicle) -> None:
    it = judged(rover, 20.0, stands, lambda t: (0.1 * (-1) ** int(4 * t), 0.0))
    assert it.state == DRIVING


def test_commands_end_with_their_timeout(rover: Vehicle) -> None:
    it = judged(rover, 20.0, stands, lambda t: (0.5, 0.0) if t < 2.0 else None)
    assert (it.state, it.stuck_seconds) == (STANDING, 0.0)


def test_who_is_stuck_stays_so_until_it_is_told_to_stop_or_moves(rover: Vehicle) -> None:
    """A driver that ends with its run sends no command to stop."""

    def gives_up(t: float) -> Command:
        return (0.5, 0.0) if t < 5.0 else None

    it = judged(rover, 20.0, stands, gives_up)
    assert (it.state, it.stuck_seconds) == (STUCK, pytest.approx(20.0))
    it = judged(rover, 20.0, stands, lambda t: (0.0, 0.0) if t > 10.0 else gives_up(t))
    assert (it.state, it.stuck_seconds) == (STANDING, pytest.approx(10.1, abs=0.11))
    it = judged(rover, 20.0, ahead(0.0), lambda t: (0.5, 0.0) if t > 10.0 else gives_up(t))
    assert it.state == STUCK

    def moves(t: float) -> Pose:
        return 0.5 * max(0.0, t - 10.0), *REST[1:]

    it = judged(rover, 20.0, moves, lambda t: (0.5, 0.0) if t > 10.0 else gives_up(t))
    assert it.state == DRIVING
    assert it.stuck_seconds == pytest.approx(10.3, abs=0.3)


def test_who_follows_is_driving(rover: Vehicle) -> None:
    it = judged(rover, 10.0, ahead(0.5), always(0.5))
    assert (it.state, it.problems()) == (DRIVING, [])
    assert it.driven_m == pytest.approx(5.0)
    assert it.speed_share == pytest.approx(1.0, abs=0.02)
    assert it.turn_share is None


def test_backward_counts_as_ahead(rover: Vehicle) -> None:
    assert judged(rover, 10.0, ahead(-0.5), always(-0.5)).speed_share == pytest.approx(1, abs=0.02)
    wrong_way = judged(rover, 10.0, ahead(-0.5), always(0.5))
    assert wrong_way.speed_share == pytest.approx(-1, abs=0.02)


def test_up_a_slope_counts_the_way_on_the_slope(rover: Vehicle) -> None:
    def climbs(t: float) -> Pose:
        along = 0.5 * t
        return along * cos(0.35), 0.0, along * sin(0.35), 0.0, -0.35, 0.0

    assert judged(rover, 10.0, climbs, always(0.5)).speed_share == pytest.approx(1.0, abs=0.02)


def test_a_turn_on_the_spot_is_motion_if_it_is_commanded(rover: Vehicle) -> None:
    def spins(t: float) -> Pose:
        return *REST[:5], 0.8 * t

    it = judged(rover, 20.0, spins, always(0.0, 1.0))
    assert (it.state, it.problems()) == (DRIVING, [])
    assert it.turn_share == pytest.approx(0.8, abs=0.01)
    assert judged(rover, 20.0, spins, always(0.5)).state == STUCK
    assert judged(rover, 20.0, stands, always(0.0, 1.0)).state == STUCK


def test_a_circle_through_its_start_is_driving(rover: Vehicle) -> None:
    def circles(t: float) -> Pose:
        return 0.25 * sin(2 * t), 0.25 * (1 - cos(2 * t)), 0.17, 0.0, 0.0, 2 * t

    it = judged(rover, 20.0, circles, always(0.5, 2.0))
    assert (it.state, it.stuck_seconds) == (DRIVING, 0.0)


def test_wheels_that_spin_in_mud_get_nowhere(rover: Vehicle) -> None:
    assert judged(rover, 20.0, ahead(0.05), always(1.0)).state == STUCK
    assert judged(rover, 20.0, ahead(0.2), always(1.0)).state == DRIVING


def test_a_slow_start_is_no_standstill(rover: Vehicle) -> None:
    """It gains 0.4 m/s every second, and is asked for 9 m/s."""
    drive = replace(rover.model.drive, max_wheel_speed_radps=60.0, max_acceleration_mps2=0.5)
    slow = replace(rover, model=replace(rover.model, drive=drive))
    it = judged(slow, 8.0, lambda t: (0.2 * t * t, *REST[1:]), always(9.0))
    assert it.stuck_seconds == 0.0


def test_who_frees_itself_was_stuck(rover: Vehicle) -> None:
    def freed(t: float) -> Pose:
        return 0.5 * max(0.0, t - 6.0), *REST[1:]

    it = judged(rover, 10.0, freed, always(0.5), touching=["table_1", "wall"])
    assert (it.state, it.failure()) == (DRIVING, None)
    (event,) = it.events
    assert (event.state, event.touching) == (STUCK, ("table_1", "wall"))
    assert event.end_seconds == pytest.approx(6.3, abs=0.15)
    assert it.stuck_seconds == pytest.approx(6.3, abs=0.15)
    assert it.problems()[0] == (
        "rover was stuck at x 0.00, y 0.00 m from 0.0 to 6.4 s (commanded 0.50 m/s, 0.00 rad/s), "
        "touching `table_1`, `wall`"
    )


def test_what_it_touches_is_named(rover: Vehicle) -> None:
    failure = judged(rover, 5.0, stands, always(0.5), touching=["table_1"]).failure()
    assert failure
    assert failure.endswith("touching `table_1`. Fix: steer clear of what it touches")


def test_a_car_needs_a_speed_with_its_turn(rover: Vehicle) -> None:
    car = convert(read(SHIPPED / "vehicles" / "car.yaml"), VehicleModel)
    failure = judged(replace(rover, model=car), 10.0, stands, always(0.0, 0.5)).failure()
    assert failure
    assert "Fix: command a speed with each turn" in failure


@pytest.mark.parametrize(
    ("pose", "state"),
    [
        (lambda t: (0.0, 0.0, 0.17, min(t, 1.5), 0.0, 0.0), TIPPED),
        (lambda t: (0.0, 0.0, 0.17, 0.0, min(t, pi), 0.0), TIPPED),
        (lambda t: (0.0, 0.0, 1000.0 - 4.9 * t * t, 0.0, 0.0, 0.0), FALLING),
        (lambda t: (7.0 * t, 0.0, 0.17, 0.0, 0.0, 0.0), LEFT),
        (lambda t: (0.0, -7.0 * t, 0.17, 0.0, 0.0, 0.0), LEFT),
        (lambda t: (0.0, 0.0, -0.5 * t, 0.0, 0.0, 0.0), LEFT),
    ],
    ids=["on its side", "on its roof", "falls", "east", "south", "below"],
)
def test_how_it_ends(rover: Vehicle, pose: Callable[[float], Pose], state: str) -> None:
    it = judged(rover, 6.0, pose)
    assert it.state == state
    failure = it.failure()
    assert failure
    assert f"rover: {state} at x " in failure
    assert " m since " in failure
    assert ". Fix: " in failure


def test_the_edges_of_the_world_are_named(rover: Vehicle) -> None:
    failure = judged(rover, 6.0, lambda t: (7.0 * t, *REST[1:])).failure()
    assert failure
    assert "between x -20 and 20 m, y -20 and 20 m" in failure


@pytest.mark.parametrize(
    "pose",
    [
        lambda t: (0.0, 0.0, max(0.17, 0.67 - 4.9 * t * t), 0.0, 0.0, 0.0),
        lambda t: (0.0, 0.0, 0.17, 0.0, 1.2 if 2.0 < t < 2.6 else 0.0, 0.0),
        lambda t: (0.0, 0.0, 0.17, 0.9, 0.0, 0.0),
        lambda t: (0.5 * t, 0.0, -0.1 * t, 0.0, 0.2, 0.0),
    ],
    ids=["a drop of half a meter", "rears up", "leans by 52 degrees", "drives downhill"],
)
def test_what_is_no_failure(rover: Vehicle, pose: Callable[[float], Pose]) -> None:
    it = judged(rover, 6.0, pose)
    assert (it.state, it.events) == (STANDING, ())


def test_states_at_other_rates_give_the_same_verdict(rover: Vehicle) -> None:
    for hz in (10, 30, 200, 400):
        it = judged(rover, 20.0, lambda t: (0.5 * min(t, 3.0), *REST[1:]), always(0.5), hz=hz)
        assert it.state == STUCK
        assert it.speed_share == pytest.approx(0.15, abs=0.02)


def test_commands_act_from_their_stamp_in_whatever_order_they_come(rover: Vehicle) -> None:
    tracker = MissionTracker(rover, BOX)
    for t in (9.0, 0.0, 0.4, 0.2):
        tracker.commanded(t, 0.5, 0.0)
    for i in range(20):
        tracker.moved(i / 10, (0.05 * i, 0.0, 0.17), (0.0, 0.0, 0.0, 1.0))
    # From 0 to 0.9 s, and a ramp down.
    assert tracker.mission().commanded_m == pytest.approx(0.45, abs=0.07)


@pytest.mark.parametrize("bad", [(nan, 0.0), (0.5, inf)])
def test_commands_that_physics_refuses_do_not_count(rover: Vehicle, bad: Command) -> None:
    it = judged(rover, 5.0, stands, lambda t: bad)
    assert (it.state, it.commanded_m, it.commanded_rad) == (STANDING, 0.0, 0.0)


def test_commands_of_single_wheels_count(rover: Vehicle) -> None:
    model = rover.model
    assert isinstance(model.drive, SideSteered)
    wheels = {wheel.name: 2.0 for wheel in model.wheels}
    assert wheels_twist(model, wheels) == pytest.approx((0.3302, 0.0))
    turning = {name: -1.0 if "left" in name else 1.0 for name in wheels}
    speed, turn = wheels_twist(model, turning)
    assert speed == 0.0
    assert turn == pytest.approx(0.3302 / (0.5708 * 1.805))


def along(route: Route, share: float, placement: Placement) -> tuple[float, float]:
    """Return the place at a share of a route."""
    made = line(route, start_m=(placement.x_m, placement.y_m), heading_rad=0.0)
    leg = Leg(made.points_m, made.speeds_mps)
    x, y = leg.point(share * leg.length_m).tolist()
    return x, y


@pytest.mark.parametrize(
    "route",
    [Circle(radius_m=2.0, laps=3), FigureEight(radius_m=1.0), ThereAndBack(length_m=4.0)],
)
@pytest.mark.parametrize("share", [0.3, 0.8, 1.0])
def test_the_share_of_a_route_counts_laps_and_crossings(
    rover: Vehicle, route: Route, share: float
) -> None:
    place = Placement(x_m=1.0, y_m=2.0)
    vehicle = replace(rover, route=route, placement=place)

    def follows(t: float) -> Pose:
        x, y = along(route, min(share, t / 60.0), place)
        return x + 0.02, y - 0.03, *REST[2:]

    assert judged(vehicle, 60.0, follows, hz=10).route_share == pytest.approx(share, abs=0.02)


def test_who_joins_later_finds_the_place_on_the_route(rover: Vehicle) -> None:
    vehicle = replace(rover, route=ThereAndBack(length_m=10.0))
    it = judged(vehicle, 9.0, ahead(1.0), hz=10, from_s=5.0)
    assert it.route_share == pytest.approx(0.45, abs=0.01)


def test_who_stands_has_driven_nothing_of_a_closed_route(rover: Vehicle) -> None:
    vehicle = replace(rover, route=Circle(radius_m=1.0, laps=4))
    assert judged(vehicle, 5.0, stands, hz=10).route_share == 0.0


def test_the_world_ends_where_its_floor_does(lab: Scenario) -> None:
    box = world_box(lab)
    assert box is not None
    low, high = box
    np.testing.assert_allclose(low[:2], (-9.0, -7.0))
    np.testing.assert_allclose(high[:2], (9.0, 7.0))
    bare = replace(
        lab.world, room=None, furniture=(), outdoors=(), solids=(), clutter=None, terrain=None
    )
    assert world_box(replace(lab, world=bare)) is None
