# SPDX-License-Identifier: Apache-2.0
"""The static solids of a world as bodies of the backend.

What vehicles can roll over is ground, all else is an obstacle; wheels touch the ground, a chassis
touches both. Ground is what is low, what is declared drivable, and a box that leans: a ramp. Solids
share bodies, since each body costs time in every step even when nothing touches it; a mesh has a
body of its own.
"""

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from msgspec import UnsetType

from groundlink.core.frames import Floats, matrix_from_quaternion
from groundlink.world.bounds import bounds
from groundlink.world.roughness import Roughness, smooth
from groundlink.world.solids import Box, Material, Mesh, Soil, Solid

from .backend import GROUND, MAX_SOLIDS, OBSTACLE, Backend, Surface

CELL_M = 6.0
"""Solids share a body with neighbors in a cell of this size; larger solids have their own. Bullet
checks a body that spans the room in every step. Measured best of 1 to 20 m in the laboratory."""

RAMP_COSINE = 0.7
"""Of the steepest ramp, 45 degrees."""

LEVEL_COSINE = 0.9999
"""Of the flattest ramp, 0.8 degrees: a table that stands a little askew is no ramp."""


@dataclass(frozen=True)
class StaticBody:
    """A body that stands for some solids of one friction, roughness and soil."""

    friction: float
    roughness: float
    """Heights of its roughness, in units of those of class A."""

    soil: Soil | UnsetType

    solids: Sequence[Solid]


def add_statics(
    backend: Backend,
    solids: Sequence[Solid],
    materials: Mapping[str, Material],
    *,
    clearance_m: float,
    roughness: Roughness = smooth,
    lowest_m: Callable[[Floats, Floats], float] = lambda low, high: 0.0,
) -> dict[int, StaticBody]:
    """Add solids to a backend; return what each body stands for.

    Parameters
    ----------
    clearance_m
        solids that reach no higher above the terrain are ground.
    roughness
        of each material.
    lowest_m
        height of the lowest terrain beneath a box, by the box's corners.
    """
    statics: dict[int, StaticBody] = {}
    alike: dict[tuple[object, int, float, float, Soil | UnsetType], list[Solid]] = defaultdict(list)
    for solid in solids:
        low, high = bounds(solid)
        alone = max(high - low) >= CELL_M or isinstance(solid.shape, Mesh)
        cell = solid.name if alone else tuple((low + high) // (2 * CELL_M))
        rolled = solid.drivable or _is_ramp(solid) or high[2] - lowest_m(low, high) <= clearance_m
        group = GROUND if rolled else OBSTACLE
        name, material = solid.material, materials[solid.material]
        alike[cell, group, material.friction, roughness(name), material.soil].append(solid)
    for (_, group, friction, rough, soil), members in alike.items():
        for first in range(0, len(members), MAX_SOLIDS):
            some = members[first : first + MAX_SOLIDS]
            # With a restitution of 1 here, that of the chassis decides.
            body = backend.add_body(some, Surface(friction, 1.0, group))
            statics[body] = StaticBody(friction, rough, soil, some)
    return statics


def _is_ramp(solid: Solid) -> bool:
    """Return whether a solid is a box that leans by no more than can be driven up."""
    upright = matrix_from_quaternion(solid.orientation)[2, 2]
    return isinstance(solid.shape, Box) and RAMP_COSINE <= upright < LEVEL_COSINE
