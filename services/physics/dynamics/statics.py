# SPDX-License-Identifier: Apache-2.0
"""The static solids of a world as bodies of the physics engine.

Rule: what can be rolled over is ground, the rest are obstacles; wheels meet the ground, chassis
meet both. A box that leans is a ramp, so ground however high, as is what says that it is. Solids
share bodies, since each body costs time in every step even when nothing touches it; a mesh has one
for itself.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from groundlink.core.fields import Quaternion, Vector3
from groundlink.core.frames import IDENTITY_QUATERNION, Floats, matrix_from_quaternion
from groundlink.world.bounds import bounds
from groundlink.world.solids import Box, Cylinder, Material, Mesh, Shape, Solid, Sphere

from .engine import Engine
from .static_mesh import StaticMeshes

RAY, GROUND, OBSTACLE, CHASSIS, WHEEL, TERRAIN, SCRIPTED, FREE = (1 << bit for bit in range(8))
"""Groups of collision filters; the engine's own rays are in the first."""

COLLIDES_WITH = {
    GROUND: RAY | CHASSIS | WHEEL | FREE,
    OBSTACLE: RAY | CHASSIS | FREE,
    CHASSIS: RAY | GROUND | OBSTACLE | CHASSIS | SCRIPTED | FREE,
    WHEEL: RAY | GROUND,
    SCRIPTED: RAY | CHASSIS | FREE,
    FREE: RAY | GROUND | OBSTACLE | CHASSIS | SCRIPTED | FREE,
}
"""Actors are DRIVEN where they go their own way, else FREE."""

COMPOUND_LIMIT = 16
"""PyBullet's MAX_COMPOUND_COLLISION_SHAPES: what createCollisionShapeArray takes at most."""

CELL_M = 6.0
"""Solids share a body with neighbors in a cell of this size, larger ones stay alone: a body that
spans the room would be looked into in every step. Measured best of 1 to 20 m in the laboratory."""


RAMP_COSINE = 0.7
"""Of the steepest ramp, 45 degrees."""

LEVEL_COSINE = 0.9999
"""Of the flattest one, 0.8 degrees: a table that stands a little askew is none."""


@dataclass(frozen=True)
class StaticBody:
    """A body of the engine that stands for some solids."""

    friction: float
    solids: Sequence[Solid]


def add_statics(
    engine: Engine,
    solids: Sequence[Solid],
    materials: Mapping[str, Material],
    *,
    clearance_m: float,
    lowest_m: Callable[[Floats, Floats], float] = lambda low, high: 0.0,
) -> dict[int, StaticBody]:
    """Put solids into the engine.

    Parameters
    ----------
    clearance_m
        what reaches no higher above the terrain is ground.
    lowest_m
        how low the terrain is beneath a box, by its corners.

    Returns
    -------
    dict
        what each body is, by the engine's number.
    """
    statics: dict[int, StaticBody] = {}
    alike: dict[tuple[object, int, float], list[Solid]] = defaultdict(list)
    for solid in solids:
        low, high = bounds(solid)
        alone = max(high - low) >= CELL_M or isinstance(solid.shape, Mesh)
        cell = solid.name if alone else tuple((low + high) // (2 * CELL_M))
        rolled = solid.drivable or _is_ramp(solid) or high[2] - lowest_m(low, high) <= clearance_m
        group = GROUND if rolled else OBSTACLE
        alike[cell, group, materials[solid.material].friction].append(solid)
    meshes = StaticMeshes(engine)
    for (_, group, friction), members in alike.items():
        for start in range(0, len(members), COMPOUND_LIMIT):
            some = members[start : start + COMPOUND_LIMIT]
            body = _add(engine, some, meshes)
            # Bullet multiplies both sides' restitution; with 1 here, that of the chassis decides.
            engine.changeDynamics(body, -1, lateralFriction=friction, restitution=1.0)
            engine.setCollisionFilterGroupMask(body, -1, group, COLLIDES_WITH[group])
            statics[body] = StaticBody(friction, some)
    return statics


def _is_ramp(solid: Solid) -> bool:
    """Return whether a solid is a box that leans by no more than can be driven up."""
    upright = matrix_from_quaternion(solid.orientation)[2, 2]
    return isinstance(solid.shape, Box) and RAMP_COSINE <= upright < LEVEL_COSINE


def _add(engine: Engine, solids: Sequence[Solid], meshes: StaticMeshes) -> int:
    """Put solids into the engine as one body, and return its number."""
    if len(solids) == 1:
        [solid] = solids
        if isinstance(solid.shape, Mesh):
            return meshes.put(solid, solid.shape)
        kind, half_extents, radius, length = _arguments(engine, solid.shape)
        shape = engine.createCollisionShape(
            kind, halfExtents=half_extents, radius=radius, height=length
        )
        body: int = engine.createMultiBody(
            baseCollisionShapeIndex=shape,
            basePosition=solid.position_m,
            baseOrientation=solid.orientation,
        )
        return body
    return body_of(engine, solids, (0.0, 0.0, 0.0), IDENTITY_QUATERNION)


def body_of(
    engine: Engine,
    solids: Sequence[Solid],
    position_m: Vector3,
    orientation: Quaternion,
    *,
    mass_kg: float = 0.0,
    center_m: Vector3 = (0.0, 0.0, 0.0),
) -> int:
    """Put solids that are no meshes into the engine as one body; return its number.

    Parameters
    ----------
    position_m, orientation
        world_from_body; the solids are in the body's frame.
    mass_kg, center_m
        with no mass it is not moved by what it touches; the center of mass is in the body's frame.
    """
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
    body: int = engine.createMultiBody(
        baseMass=mass_kg,
        baseCollisionShapeIndex=shape,
        basePosition=position_m,
        baseOrientation=orientation,
        baseInertialFramePosition=center_m,
    )
    return body


def _arguments(engine: Engine, shape: Shape) -> tuple[int, list[float], float, float]:
    """Return a shape's type, half extents, radius and length, as PyBullet wants them."""
    if isinstance(shape, Box):
        return engine.GEOM_BOX, [length / 2 for length in shape.size_m], 0.0, 0.0
    if isinstance(shape, Cylinder):
        return engine.GEOM_CYLINDER, [0.0, 0.0, 0.0], shape.radius_m, shape.length_m
    assert isinstance(shape, Sphere)  # no mesh comes here
    return engine.GEOM_SPHERE, [0.0, 0.0, 0.0], shape.radius_m, 0.0
