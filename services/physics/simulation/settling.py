# SPDX-License-Identifier: Apache-2.0
"""Equilibrium of a vehicle that starts on terrain: springs, treads and pose at rest.

Rule: computed in an engine of its own, with the terrain and nothing else, so that nothing in the
run moves. On flat ground springs are at their loaded rest, and there is nothing to compute. A
vehicle that slides, as on ice, or starts above the ground, starts where
`groundlink.world.spawn_pose` puts it. Motion is taken away whenever it begins to slow down (kinetic
damping), so that springs do not swing beyond their rest: a tall vehicle would tip by that.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing

from groundlink.core.clock import TICK_NANOS
from groundlink.scenario.schema import Vehicle
from groundlink.world.solids import Material
from groundlink.world.terrain import Ground
from services.physics.dynamics.engine import Engine
from services.physics.dynamics.terrain import TerrainWindows, reach_of
from services.physics.vehicle.vehicle import RestState, SimulatedVehicle

MOST_TICKS = 2400
"""After which a vehicle that still moves is not at rest anywhere near."""

STILL_TICKS = 20
"""Longer than a swing stands still at its turning point."""

STILL = 5e-5
"""Velocity, m/s and rad/s, below which a vehicle is at rest."""


def settled(
    vehicle: Vehicle, ground: Ground, materials: Mapping[str, Material]
) -> RestState | None:
    """Return how a vehicle rests on the terrain at its placement; None if it does not."""
    if vehicle.placement.z_m > 0:
        return None
    with closing(Engine()) as engine:
        land = TerrainWindows(engine, ground, materials)
        it = SimulatedVehicle(
            engine, vehicle, lambda _, point: land.friction_at(*point[:2]), ground=ground
        )
        land.carry(it, vehicle.model.name, reach_of(vehicle.model))
        still, fastest, rises = 0, 0.0, False
        for tick in range(MOST_TICKS):
            it.act(tick * TICK_NANOS)
            land.follow()
            engine.stepSimulation()
            it.sense()
            before, fastest = fastest, it.fastest
            if rises and fastest < before:
                it.stop()
            rises = fastest > before
            still = still + 1 if fastest < STILL else 0
            if still == STILL_TICKS:
                return it.at_rest()
    return None
