# SPDX-License-Identifier: Apache-2.0
"""The static solids of a world as bodies of the physics engine.

Rule: what can be rolled over is ground, the rest are obstacles; wheels meet the ground, chassis
meet both. Solids share bodies: each body costs time in every step even when nothing touches it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from groundlink.frames import IDENTITY_QUATERNION
from groundlink.world.bounds import bounds
from groundlink.world.solids import Box, Cylinder, Material, Shape, Solid

from .engine import Engine

RAY, GROUND, OBSTACLE, CHASSIS, WHEEL = 1, 2, 4, 8, 16
"""Groups of collision filters; the engine's own rays are in the first."""

MEETS = {
    GROUND: RAY | CHASSIS | WHEEL,
    OBSTACLE: RAY | CHASSIS,
    CHASSIS: RAY | GROUND | OBSTACLE | CHASSIS,
    WHEEL: RAY | GROUND,
}

COMPOUND_LIMIT = 16
"""PyBullet's MAX_COMPOUND_COLLISION_SHAPES: what createCollisionShapeArray takes at most."""

CELL_M = 6.0
"""Solids share a body with neighbours in a cell of this size, larger ones stay alone: a body that
spans the room would be looked into in every step. Measured best of 1 to 20 m in the laboratory."""


@dataclass(frozen=True)
class Static:
    """A body of the engine that stands for some solids."""

    friction: float
    solids: Sequence[Solid]


def add_statics(
    engine: Engine,
    solids: Sequence[Solid],
    materials: Mapping[str, Material],
    *,
    ground_below_m: float,
) -> dict[int, Static]:
    """Put solids into the engine; those whose top is not above `ground_below_m` are ground.

    Returns
    -------
    dict
        what each body is, by the engine's number.
    """
    statics: dict[int, Static] = {}
    alike: dict[tuple[object, int, float], list[Solid]] = defaultdict(list)
    for solid in solids:
        low, high = bounds(solid)
        cell = tuple((low + high) // (2 * CELL_M)) if max(high - low) < CELL_M else solid.name
        group = GROUND if high[2] <= ground_below_m else OBSTACLE
        alike[cell, group, materials[solid.material].friction].append(solid)
    for (_, group, friction), members in alike.items():
        for start in range(0, len(members), COMPOUND_LIMIT):
            some = members[start : start + COMPOUND_LIMIT]
            body = _add(engine, some)
            # Bullet multiplies both sides' restitution; with 1 here, that of the chassis decides.
            engine.changeDynamics(body, -1, lateralFriction=friction, restitution=1.0)
            engine.setCollisionFilterGroupMask(body, -1, group, MEETS[group])
            statics[body] = Static(friction, some)
    return statics


def _add(engine: Engine, solids: Sequence[Solid]) -> int:
    """Put solids into the engine as one body, and return its number."""
    if len(solids) == 1:
        kind, half_extents, radius, length = _arguments(engine, solids[0].shape)
        shape = engine.createCollisionShape(
            kind, halfExtents=half_extents, radius=radius, height=length
        )
        position, orientation = solids[0].position_m, solids[0].orientation
    else:
        arguments = [_arguments(engine, solid.shape) for solid in solids]
        kinds, halves, radii, lengths = zip(*arguments, strict=True)
        shape = engine.createCollisionShapeArray(
            shapeTypes=kinds,
            halfExtents=halves,
            radii=radii,
            lengths=lengths,
            collisionFramePositions=[solid.position_m for solid in solids],
            collisionFrameOrientations=[solid.orientation for solid in solids],
        )
        position, orientation = (0.0, 0.0, 0.0), IDENTITY_QUATERNION
    body: int = engine.createMultiBody(
        baseCollisionShapeIndex=shape, basePosition=position, baseOrientation=orientation
    )
    return body


def _arguments(engine: Engine, shape: Shape) -> tuple[int, list[float], float, float]:
    """Return a shape's type, half extents, radius and length, as PyBullet wants them."""
    if isinstance(shape, Box):
        return engine.GEOM_BOX, [length / 2 for length in shape.size_m], 0.0, 0.0
    if isinstance(shape, Cylinder):
        return engine.GEOM_CYLINDER, [0.0, 0.0, 0.0], shape.radius_m, shape.length_m
    return engine.GEOM_SPHERE, [0.0, 0.0, 0.0], shape.radius_m, 0.0
