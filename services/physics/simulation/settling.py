# SPDX-License-Identifier: Apache-2.0
"""Equilibrium of a vehicle that starts on terrain: springs, treads and pose at rest.

Computed in a backend of its own with the terrain alone, so that nothing in the run moves. On flat
ground springs start at their loaded rest, and nothing is computed. A vehicle that slides, as on
ice, or starts above the ground, starts where `groundlink.scene.spawn_pose` puts it.

Kinetic damping: all motion is taken away whenever it begins to slow down. Otherwise springs would
swing beyond their rest, and a tall vehicle would tip over.
"""

from collections.abc import Callable, Mapping
from contextlib import closing

from groundlink.core.clock import TICK_NANOS
from groundlink.scenario.schema import Vehicle
from groundlink.world.solids import Material
from groundlink.world.terrain import Ground
from services.physics.dynamics.backend import Backend
from services.physics.dynamics.bullet import BulletBackend
from services.physics.dynamics.terrain import TerrainWindows, reach_of
from services.physics.vehicle.vehicle import RestState, SimulatedVehicle

MAX_TICKS = 2400
"""A vehicle that still moves after these is not at rest anywhere near."""

STILL_TICKS = 20
"""Longer than a swing stands still at its turning point."""

STILL = 5e-5
"""Velocity, m/s and rad/s, below which a vehicle is at rest."""


def settled(
    vehicle: Vehicle,
    ground: Ground,
    materials: Mapping[str, Material],
    new_backend: Callable[[], Backend] = BulletBackend,
) -> RestState | None:
    """Return how a vehicle rests on the terrain at its placement; None if it does not."""
    if vehicle.placement.z_m > 0:
        return None
    with closing(new_backend()) as backend:
        terrain = TerrainWindows(backend, ground, materials)
        it = SimulatedVehicle(
            backend, vehicle, lambda _, point: terrain.friction_at(*point[:2]), ground=ground
        )
        terrain.carry(it, vehicle.model.name, reach_of(vehicle.model))
        still, fastest, rises = 0, 0.0, False
        for tick in range(MAX_TICKS):
            it.act(tick * TICK_NANOS)
            terrain.follow()
            backend.step()
            it.sense()
            before, fastest = fastest, it.fastest
            if rises and fastest < before:
                it.stop()
            rises = fastest > before
            still = still + 1 if fastest < STILL else 0
            if still == STILL_TICKS:
                return it.at_rest()
    return None
