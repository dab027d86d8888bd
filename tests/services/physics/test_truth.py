# SPDX-License-Identifier: Apache-2.0
"""The ground truth is the state in the words of odometry, at its declared instants."""

from __future__ import annotations

import math

import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.clock import TICK_NANOS
from groundlink.messages import State, VehicleState, packed
from groundlink.scenario import load
from groundlink.scenario.load import SHIPPED
from groundlink.scenario.schema import GroundTruth, Vehicle
from services.physics.truth import Truth

EPOCH = 10**18
LEFT = (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))
"""Turned by 90 degrees: the base's x is the world's y."""


def vehicle(rate_hz: float) -> Vehicle:
    shipped = load(SHIPPED / "indoor_lab.yaml").vehicles[0]
    return replace(shipped, frame_prefix="a/", ground_truth=GroundTruth(rate_hz=rate_hz))


def state(tick: int) -> State:
    moving = VehicleState(
        link_poses=packed(np.array([[1.0, 2.0, 3.0, *LEFT]])),
        base_velocity=packed(np.array([0.0, 0.5, 0.25, 0.1, 0.0, 0.3])),
        joint_positions=packed(np.empty(0)),
        joint_velocities=packed(np.empty(0)),
    )
    return State("run", EPOCH, tick, tick * TICK_NANOS, "", {"rover": moving})


def test_velocities_are_in_the_base_and_the_pose_in_the_world() -> None:
    odometry = Truth(vehicle(50.0)).odometry(state(0))
    assert odometry is not None
    assert (odometry.frame, odometry.child_frame) == ("world", "a/base_link")
    assert (odometry.position_m, odometry.orientation) == ((1.0, 2.0, 3.0), LEFT)
    assert odometry.linear_mps == pytest.approx((0.5, 0.0, 0.25))
    assert odometry.angular_radps == pytest.approx((0.0, -0.1, 0.3))
    assert not any(bytes(odometry.pose_covariance))


@pytest.mark.parametrize("rate_hz", [50.0, 30.0, 400.0])
def test_it_comes_at_its_rate_without_drift(rate_hz: float) -> None:
    truth = Truth(vehicle(rate_hz))
    stamps = [found.stamp_nanos for tick in range(401) if (found := truth.odometry(state(tick)))]
    assert len(stamps) == rate_hz + 1
    assert stamps == [EPOCH + int(i * 10**9 // rate_hz) for i in range(len(stamps))]
