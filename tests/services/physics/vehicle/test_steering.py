# SPDX-License-Identifier: Apache-2.0
"""From a velocity to wheels, for each kind of drive."""

from math import atan, cos, hypot, isfinite, radians, sin, tan

import pytest

from groundlink.scenario.vehicle import VehicleModel
from services.physics.vehicle.steering import AckermannSteering, steering
from tests.services.physics.grounds import VEHICLES, shipped

SIDE_STEERED = ("rover", "decontamination_robot", "tank")


@pytest.mark.parametrize("name", SIDE_STEERED)
def test_straight_on_all_shafts_roll_alike(name: str) -> None:
    model = shipped(name)
    radii = [shaft.radius_m for shaft in model.drive.shafts(model.wheels) if shaft.driven]
    speeds = steering(model).speeds((0.5, 0.0))
    assert speeds == pytest.approx([0.5 / radius for radius in radii])


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("rover", [-0.2854 * 1.805 / 0.1651, 0.2854 * 1.805 / 0.1651] * 2),
        ("decontamination_robot", [-2.7, 2.7]),
    ],
)
def test_to_the_left_the_right_side_turns_forward(name: str, expected: list[float]) -> None:
    assert steering(shipped(name)).speeds((0.0, 1.0)) == pytest.approx(expected)


@pytest.mark.parametrize("asked", [(9.0, 0.0), (-9.0, 0.0), (0.0, 50.0), (3.0, 4.0), (1e300, 1.0)])
@pytest.mark.parametrize("name", SIDE_STEERED)
def test_too_fast_is_slowed_on_the_same_curve(name: str, asked: tuple[float, float]) -> None:
    model = shipped(name)
    geometry = steering(model)
    factor = 10.0
    linear, angular = geometry.within_limits((factor * asked[0], factor * asked[1]))
    fastest = max(map(abs, geometry.speeds((linear, angular))))
    assert fastest == pytest.approx(model.drive.max_wheel_speed_radps)
    assert linear * asked[1] == pytest.approx(angular * asked[0])


def car() -> VehicleModel:
    return shipped("car")


def wheelbase_and_track(model: VehicleModel) -> tuple[float, float]:
    front, rear = (
        next(w.center_m for w in model.wheels if w.center_m[1] > 0 and (w.center_m[0] > 0) is ahead)
        for ahead in (True, False)
    )
    return front[0] - rear[0], 2 * front[1]


@pytest.mark.parametrize("radius_m", [8.0, -8.0, 50.0])
def test_a_cars_axles_meet_in_the_middle_of_its_curve(radius_m: float) -> None:
    model = car()
    length, track = wheelbase_and_track(model)
    left, right = steering(model).angles((4.0, 4.0 / radius_m))
    assert tan(left) == pytest.approx(length / (radius_m - track / 2))
    assert tan(right) == pytest.approx(length / (radius_m + track / 2))


def test_a_car_turns_no_sharper_than_its_joints() -> None:
    model = car()
    most = radians(model.drive.max_steering_deg)  # type: ignore[union-attr]
    length, track = wheelbase_and_track(model)
    left, right = steering(model).angles((1.0, 9.0))
    assert left == pytest.approx(most)
    assert right == pytest.approx(atan(length / (length / tan(most) + track)))
    assert model.least_radius_m == pytest.approx(length / tan(most) + track / 2)


def test_a_cars_wheels_roll_on_circles_about_one_point() -> None:
    model = car()
    geometry, radius_m = steering(model), 9.0
    length, track = wheelbase_and_track(model)
    speeds = geometry.speeds((3.0, 0.0), geometry.angles((3.0, 3.0 / radius_m)))
    shafts = [shaft for shaft in model.drive.shafts(model.wheels) if shaft.driven]
    for shaft, speed in zip(shafts, speeds, strict=True):
        x, y, _ = model.wheels[shaft.wheels[0]].center_m
        ahead = length if x > 0 else 0.0
        expected = 3.0 * hypot(radius_m - y, ahead) / radius_m
        assert speed * shaft.radius_m == pytest.approx(expected)
    assert track > 0


def test_car_ignores_turning_in_place() -> None:
    geometry = steering(car())
    before = geometry.angles((1.0, 0.1))
    assert geometry.angles((0.0, 1.0)) == before
    assert geometry.speeds((0.0, 1.0), before) == pytest.approx(
        [0.0] * len(geometry.speeds((0, 0)))
    )
    assert cos(before[0]) > sin(before[0])


@pytest.mark.parametrize("name", VEHICLES)
@pytest.mark.parametrize("twist", [(0.0, 0.0), (1.5, 0.0), (1.5, 0.2), (-1.0, 0.1)])
def test_joints_that_turn_for_a_velocity_amount_to_it(
    name: str, twist: tuple[float, float]
) -> None:
    geometry = steering(shipped(name))
    # A base that drives sideways has a third figure.
    whole = (*twist, 0.3)[: len(geometry.STANDSTILL)]
    angles = geometry.angles(whole)
    speeds = geometry.speeds(whole, angles)
    assert geometry.twist(speeds, angles) == pytest.approx(whole, abs=1e-12)


def test_a_wheel_that_turns_about_the_middle_of_the_axle_has_a_finite_curve() -> None:
    geometry = steering(shipped("car"))
    assert isinstance(geometry, AckermannSteering)
    geometry._steered = [(1.5, 1.0), (1.5, -1.0)]
    angle = atan(-1.5)
    assert tan(angle) == -1.5
    assert all(map(isfinite, geometry.twist((1.0, 1.0), (angle, 0.0))))
