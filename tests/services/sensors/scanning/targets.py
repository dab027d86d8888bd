# SPDX-License-Identifier: Apache-2.0
"""Things for a scanner at rest to look at, in an empty world, and what it measures of them.

The sensor is in the world's origin, 1 m above its vehicle, and looks along x unless told otherwise.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from groundlink.scenario.schema import Scenario
from groundlink.world.solids import Box, Material, Solid
from groundlink.world.weather import Weather
from services.sensors.lidar.spec import Lidar
from services.sensors.scanning.returns import Returns
from services.sensors.scanning.scanner import Scanner
from services.sensors.scanning.sweep import Sweep
from tests.services.sensors.lidar import rooms

Floats = NDArray[np.float64]
MATERIALS = {
    "white": Material(1.0),
    "gray": Material(0.5),
    "dark": Material(0.1),
    "rubber": Material(0.05),
    "sign": Material(0.5, retroreflectivity=1.0),
    "worn_sign": Material(0.5, retroreflectivity=0.3),
}
AHEAD: dict[str, Any] = {
    "field_of_view_deg": 10.0,
    "start_deg": 5.0,
    "firings_per_revolution": 36000,
}
"""1001 firings around x."""

ABOVE_M = 1.0


def at_rest(_: float) -> tuple[Sequence[float], Sequence[float]]:
    return (0.0, 0.0, -ABOVE_M), (0.0, 0.0, 0.0)


def box(
    material: str, at_m: Sequence[float], size_m: Sequence[float], name: str = "target"
) -> Solid:
    x, y, z = size_m
    return Solid(name, Box((x, y, z)), material, position_m=tuple(at_m))  # type: ignore[arg-type]


def wall(material: str, distance_m: float, name: str = "wall") -> Solid:
    """A wall across x."""
    return box(material, (distance_m + 0.5, 0, 0), (1, 400, 400), name)


def scenario(
    *solids: Solid, weather: Weather | None = None, seed: int = 1, **lidar: Any
) -> Scenario:
    lidar = {"elevations_deg": [0.0], "mount": {"xyz_m": [0, 0, ABOVE_M]}, **AHEAD, **lidar}
    made = rooms.scenario(seed=seed, **lidar)
    far = box("dark", (0, 0, -900), (1, 1, 1), "far")
    return replace(
        made,
        world=replace(
            made.world, materials=MATERIALS, solids=(far, *solids), weather=weather or Weather()
        ),
    )


def scanner(made: Scenario) -> Scanner:
    spec = made.vehicles[0].sensors[0]
    assert isinstance(spec, Lidar)
    return Scanner(made, made.vehicles[0], spec, Sweep(spec))


def measured(made: Scenario, way: rooms.Way = at_rest) -> Returns:
    """Return the first revolution of a fresh scanner."""
    sensor = scanner(made)
    for state in rooms.states(made, way, 2):
        sensor.replica.take(state)
    return sensor.measure(0, range(sensor.sweep.seconds.shape[1])).returns


def returns(*solids: Solid, **spec: Any) -> Returns:
    return measured(scenario(*solids, **spec))


def azimuths(made: Scenario) -> Floats:
    """Return the reported azimuths, shape (lasers, firings), radians, positive to the left."""
    x, y, _ = scanner(made).sweep.directions_in_sensor.astype(np.float64)
    return np.arctan2(y, x)
