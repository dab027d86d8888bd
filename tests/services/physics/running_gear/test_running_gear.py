# SPDX-License-Identifier: Apache-2.0
"""The joint that steers: range, speed, force."""

from math import radians
from typing import Any

import pytest

from groundlink.scenario.running_gear import Ackermann, Wheel
from services.physics.running_gear.running_gear import SteeringJoint

WHEEL = Wheel(name="w", center_m=(1.0, 0.5, 0.0), radius_m=0.3, width_m=0.2, mass_kg=20.0)


def steering_joint(**fields: Any) -> SteeringJoint:
    drive = Ackermann(
        max_wheel_torque_nm=1.0, max_wheel_speed_radps=1.0, steered=("w", "v"), **fields
    )
    return SteeringJoint(WHEEL, drive)


def turned(it: SteeringJoint, asked: float, *, grip: float = 0.0, rolling: float = 0.0) -> float:
    for _ in range(400):
        it.turn(asked, grip, rolling)
    return it.angle_rad


def test_joint_reaches_its_command_within_its_range() -> None:
    assert turned(steering_joint(), 0.2) == pytest.approx(0.2)
    assert turned(steering_joint(max_steering_deg=25.0), -1.0) == pytest.approx(-radians(25.0))


def test_it_is_as_fast_as_its_drive() -> None:
    it = steering_joint(steering_speed_degps=20.0)
    assert turned(it, 0.5) == pytest.approx(radians(20.0), rel=0.01)


def test_standing_it_needs_the_force_that_the_footprint_resists_with() -> None:
    # 3000 N on a strip of 0.2 m: 150 N m.
    assert turned(steering_joint(steering_torque_nm=140.0), 0.3, grip=3000.0) == 0.0
    assert turned(steering_joint(steering_torque_nm=170.0), 0.3, grip=3000.0) == pytest.approx(0.3)
    it = steering_joint(steering_torque_nm=140.0)
    assert turned(it, 0.3, grip=3000.0, rolling=3.0) == pytest.approx(0.3)
