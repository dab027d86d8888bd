# SPDX-License-Identifier: Apache-2.0
"""Renderers of small worlds and of the laboratory, and poses to look from."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from groundlink.core.frames import Floats, multiply, quaternion_from_rpy, transform
from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.scenario.every_sensor import MOUNT_FROM_OPTICAL, Mount
from groundlink.scenario.schema import Scenario
from services.sensors.rendering.gl.pinhole import Pinhole
from services.sensors.rendering.gl.renderer import Renderer
from services.sensors.runtime.world_replica import WorldReplica

SMALL = Pinhole(160, 120, 120.0, 120.0, 79.5, 59.5)


def laboratory() -> Scenario:
    return load(SHIPPED / "indoor_lab.yaml")


def looking(at_m: Sequence[float], *, yaw_deg: float = 0.0, pitch_deg: float = 0.0) -> Floats:
    """Return world_from_optical of a level camera that is turned left, then tilted down."""
    turn = quaternion_from_rpy(0.0, np.radians(pitch_deg), np.radians(yaw_deg))
    return transform(np.asarray(at_m, np.float64), multiply(turn, MOUNT_FROM_OPTICAL))


def world_replica(scenario: Scenario) -> WorldReplica:
    return WorldReplica(scenario, scenario.vehicles[0], Mount((0.0, 0.0, 50.0)))


def parked(around: WorldReplica, at_m: Sequence[float] = (0.0, 0.0, 0.2)) -> Floats:
    """Return poses with all links at one place: wheels inside the hull."""
    return np.tile([*at_m, 0.0, 0.0, 0.0, 1.0], (len(around.links), 1)).astype(np.float64)


def renderer(scenario: Scenario, pinhole: Pinhole = SMALL, **options: Any) -> Renderer:
    """Return a renderer whose vehicles are parked far below the world."""
    around = world_replica(scenario)
    made = Renderer(scenario.world, around, pinhole, **options)
    made.place(parked(around, (0.0, 0.0, -400.0)))
    return made
