# SPDX-License-Identifier: Apache-2.0
"""Checks of a satellite receiver against its scenario."""

from collections.abc import Iterator

from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.scenario.sensor_kinds import Problem

from .spec import Gnss


def problems(spec: Gnss, vehicle: Vehicle, scenario: Scenario) -> Iterator[Problem]:
    """Yield a problem if the world has no location on the Earth."""
    if scenario.world.datum is None:
        yield Problem(
            (),
            f"`{spec.name}` receives satellites, but `world.datum` is missing: add `datum: "
            "{latitude_deg: ..., longitude_deg: ..., altitude_m: ...}` of the world's origin",
        )
