# SPDX-License-Identifier: Apache-2.0
"""A cart at rest with one sensor, in a world of a few solids: the bench of the plots."""

from collections.abc import Iterator, Sequence
from typing import Any

import msgspec
import numpy as np
import yaml
from msgspec.structs import replace

from groundlink.core.clock import TICK_NANOS
from groundlink.core.frames import Floats
from groundlink.loader.scenario_files import SHEETS, SHIPPED
from groundlink.messages.base import State, VehicleState, packed
from groundlink.scenario.schema import Scenario
from groundlink.world.solids import Box, Material, Solid

WHEELS = ("left", "right")
_FAR = Solid("far", Box((1.0, 1.0, 1.0)), "gray", (0.0, 0.0, -900.0))
"""A world has at least one solid; no sensor sees this one."""


def sheet(name: str, **fields: Any) -> dict[str, Any]:
    """Return the fields of a sensor of a shipped data sheet, some of them replaced."""
    text = (SHIPPED / SHEETS / f"{name}.yaml").read_text(encoding="utf-8")
    return {**yaml.safe_load(text), "name": "it", "topic": "/it", "frame": "it_link", **fields}


def cart_model(wheels: tuple[str, str], *, drive: str) -> dict[str, Any]:
    """Return the fields of a vehicle with two wheels, given by name."""
    wheel = {"radius_m": 0.1, "width_m": 0.05, "mass_kg": 1}
    return {
        "name": "cart",
        "chassis": {"mass_kg": 10, "size_m": [1, 1, 1]},
        "suspension": {},
        "wheels": [
            {"name": name, "center_m": [0, y, 0], **wheel}
            for name, y in zip(wheels, (0.25, -0.25), strict=True)
        ],
        "drive": {"kind": drive, "max_wheel_torque_nm": 10, "max_wheel_speed_radps": 10},
    }


def bench(sensor: dict[str, Any], *solids: Solid, seed: int = 1) -> Scenario:
    """Return a scenario with the sensor on a cart; material `gray` reflects a half."""
    document: dict[str, Any] = {
        "name": "bench",
        "seed": seed,
        "world": {"name": "empty", "materials": {}},
        "vehicles": [
            {
                "name": "cart",
                "model": cart_model(WHEELS, drive="differential"),
                "sensors": [sensor],
            }
        ],
    }
    made = msgspec.convert(document, Scenario)
    materials = {"gray": Material(0.5), "rubber": Material(0.05)}
    return replace(made, world=replace(made.world, materials=materials, solids=(_FAR, *solids)))


def states(wheel_angles: Sequence[float] | Floats = (0.0,)) -> Iterator[State]:
    """Yield a state for each angle of both wheels; the cart stays at the world's origin."""
    poses = packed(np.tile((0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0), (1 + len(WHEELS), 1)))
    still = packed(np.zeros(6))
    for tick, angle in enumerate(wheel_angles):
        angles = packed(np.full(len(WHEELS), float(angle)))
        cart = VehicleState(poses, still, angles, packed(np.zeros(len(WHEELS))))
        yield State("bench", 1, 0, tick, tick * TICK_NANOS, "", {"cart": cart})
