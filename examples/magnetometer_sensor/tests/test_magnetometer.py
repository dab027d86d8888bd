# SPDX-License-Identifier: Apache-2.0
"""The magnetometer: the field it measures, its errors, its bytes in ROS."""

from typing import Any

import numpy as np
import pytest
from magnetometer_sensor.codec import CODEC
from magnetometer_sensor.message import MagneticField
from magnetometer_sensor.model import MagnetometerModel, measured
from magnetometer_sensor.spec import Magnetometer
from msgspec.structs import replace

from groundlink.core.frames import quaternion_from_rpy
from groundlink.loader import load
from groundlink.messages.base import BadBusMessage, State, VehicleState, packed
from groundlink.ros.cdr import from_cdr, to_cdr
from groundlink.ros.codec import Moment
from groundlink.scenario.schema import Scenario

SPEC = Magnetometer(name="compass", topic="/magnetic_field", frame="compass")
LEVEL = np.array([0.0, 0.0, 0.0, 1.0])
NO_BIAS = np.zeros(3)
LAB = load("indoor_lab")


def noise() -> np.random.Generator:
    return np.random.default_rng(7)


def model(scenario: Scenario = LAB, **fields: Any) -> MagnetometerModel:
    return MagnetometerModel(scenario, scenario.vehicles[0], replace(SPEC, **fields))


def state(tick: int) -> State:
    pose = packed(np.array([0.0, 0.0, 0.0, *LEVEL]))
    nothing = packed(np.zeros(0))
    rover = VehicleState(pose, packed(np.zeros(6)), nothing, nothing)
    return State("run", 1, 0, tick, tick * 2_500_000, "", {"rover": rover})


def test_an_ideal_one_reads_the_field_in_its_own_axes() -> None:
    assert measured(SPEC, LEVEL, NO_BIAS, noise()) == SPEC.earth_field_t
    east, north, up = SPEC.earth_field_t
    to_the_left = np.array(quaternion_from_rpy(0.0, 0.0, np.pi / 2))  # x looks north
    assert measured(SPEC, to_the_left, NO_BIAS, noise()) == pytest.approx((north, -east, up))


def test_noise_bias_and_resolution() -> None:
    noisy = replace(SPEC, noise_stddev_t=1e-6)
    source = noise()
    found = np.array([measured(noisy, LEVEL, NO_BIAS, source) for _ in range(4000)])
    assert found.std(axis=0) == pytest.approx(np.full(3, 1e-6), rel=0.05)
    coarse = replace(SPEC, resolution_t=1e-5)
    assert measured(coarse, LEVEL, np.full(3, 4e-6), noise()) == pytest.approx((0, 2e-5, -4e-5))


def test_readings_come_at_the_rate_and_again_with_the_same_bytes() -> None:
    first, second = model(noise_stddev_t=1e-6), model(noise_stddev_t=1e-6)
    readings = [found for tick in range(41) for found in first.readings(state(tick))]
    assert [found.stamp_nanos for found in readings] == [i * 10_000_000 for i in range(11)]
    again = [found for tick in range(20, 41) for found in second.readings(state(tick))]
    assert again == readings[5:]
    assert first.settled_tick() == 40


def test_a_state_without_the_vehicle_is_refused() -> None:
    with pytest.raises(BadBusMessage, match="rover"):
        model().readings(replace(state(0), vehicles={}))


def test_both_directions_of_the_codec() -> None:
    message = MagneticField(5_000_000_007, "compass", (1e-6, -2e-5, 4.5e-5), 4e-14)
    cdr = to_cdr(message)
    assert CODEC.ros_type == "sensor_msgs/msg/MagneticField"
    assert from_cdr(cdr, MagneticField, Moment(0, 0)) == message
