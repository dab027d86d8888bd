# SPDX-License-Identifier: Apache-2.0
"""Checks of wheel encoders against their vehicle."""

from collections.abc import Iterator

from groundlink.core.errors import did_you_mean
from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.scenario.sensor_kinds import Problem

from .spec import Encoders


def problems(spec: Encoders, vehicle: Vehicle, scenario: Scenario) -> Iterator[Problem]:
    """Yield a problem for each reversed wheel that the vehicle does not have."""
    wheels = [shaft.name for shaft in vehicle.model.counted]
    for i, name in enumerate(spec.reversed_wheels):
        if name not in wheels:
            hint = did_you_mean(name, wheels)
            yield Problem(("reversed_wheels", i), f"`reversed_wheels`: no wheel `{name}`; {hint}")
