# SPDX-License-Identifier: Apache-2.0
"""Checks of wheel odometry against its vehicle."""

from collections.abc import Iterator

from groundlink.core.errors import did_you_mean
from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.scenario.sensor_kinds import Problem
from groundlink.scenario.wheel_encoders import IncrementalEncoders

from .spec import WheelOdometry


def problems(spec: WheelOdometry, vehicle: Vehicle, scenario: Scenario) -> Iterator[Problem]:
    """Yield a problem if the vehicle lacks the encoders that the odometry reads."""
    encoders = [
        sensor.name for sensor in vehicle.sensors if isinstance(sensor, IncrementalEncoders)
    ]
    if spec.encoders not in encoders:
        hint = did_you_mean(spec.encoders, encoders) if encoders else "add one"
        yield Problem(
            ("encoders",), f"`encoders`: no sensor `{spec.encoders}` of kind `encoders`; {hint}"
        )
