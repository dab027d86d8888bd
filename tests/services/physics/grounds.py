# SPDX-License-Identifier: Apache-2.0
"""The shipped vehicles, and what is put on the test track for them."""

from functools import cache
from math import cos, pi, sin

import msgspec
import numpy as np
from msgspec.structs import replace

from groundlink.core.frames import quaternion_from_rpy
from groundlink.loader import load
from groundlink.loader.document import read
from groundlink.loader.material_library import soil_library
from groundlink.loader.scenario_files import SHIPPED
from groundlink.loader.validation_errors import convert
from groundlink.scenario import Scenario
from groundlink.scenario.vehicle import VehicleModel
from groundlink.world.solids import Box, Soil, Solid
from services.physics.trials.track import MATERIALS

TRAILER = "trailer"
VEHICLES = sorted({file.stem for file in (SHIPPED / "vehicles").glob("*.yaml")} - {TRAILER})
"""Names of all shipped vehicles that drive."""

STEEP_DEG = 20.0

SOILS = msgspec.convert(soil_library(), dict[str, Soil])


@cache
def shipped(name: str) -> VehicleModel:
    """Return a shipped vehicle's model."""
    return convert(read(SHIPPED / "vehicles" / f"{name}.yaml"), VehicleModel)


@cache
def plain_scenario() -> Scenario:
    scenario = load(SHIPPED / "indoor_lab.yaml")
    return replace(scenario, world=replace(scenario.world, materials=MATERIALS))


def wall(x_m: float) -> Solid:
    """Return a wall across x, its near face there."""
    return Solid("wall", Box(size_m=(0.2, 40.0, 3.0)), "ground", (x_m + 0.1, 0.0, 1.5))


def rubble(seed: int, *, half_m: float = 15.0, count: int = 250) -> list[Solid]:
    """Return slabs that lie about tilted, with a wall around them; the middle is free."""
    random = np.random.default_rng(seed)
    slabs: list[Solid] = []
    while len(slabs) < count:
        x, y = random.uniform(-half_m, half_m, 2).tolist()
        length, width, depth = random.uniform((1, 1, 0), (4, 4, 0.2)).tolist()
        roll, pitch, yaw = (random.uniform(-1, 1, 3) * [0.35, 0.35, pi]).tolist()
        if np.hypot(x, y) > 6.0 and abs(roll) + abs(pitch) > 0.05:
            slabs.append(
                Solid(
                    f"slab_{len(slabs)}",
                    Box(size_m=(length, width, 0.5)),
                    "ground",
                    (x, y, -0.15 - depth),
                    quaternion_from_rpy(roll, pitch, yaw),
                )
            )
    for i in range(4):
        c, s = cos(i * pi / 2), sin(i * pi / 2)
        shape = Box(size_m=(1.0, 2 * half_m + 6.0, 8.0))
        middle = ((half_m + 2.5) * c, (half_m + 2.5) * s, 3.0)
        slabs.append(
            Solid(f"wall_{i}", shape, "ground", middle, quaternion_from_rpy(0.0, 0.0, i * pi / 2))
        )
    return slabs
