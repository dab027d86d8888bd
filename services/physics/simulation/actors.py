# SPDX-License-Identifier: Apache-2.0
"""Actors in the physics engine: those that go their own way, and those that are pushed.

Rule: what goes its own way is exactly where its motion says at every tick; to the engine it has the
speed of the way to the next one, so that contacts push. Wheels meet no actor: as with obstacles,
chassis do. Meshes count as the boxes around them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from msgspec.structs import replace

from groundlink.core.clock import TICK_SECONDS
from groundlink.core.fields import Quaternion, Vector3
from groundlink.core.frames import matrix_from_quaternion
from groundlink.world import motion
from groundlink.world.actors import Actor, Free, parts
from groundlink.world.bounds import bounds, half_extents, middle
from groundlink.world.solids import Box, Material, Mesh, Solid
from groundlink.world.terrain import Ground
from services.physics.dynamics.engine import Engine
from services.physics.dynamics.statics import COLLIDES_WITH, FREE, SCRIPTED, body_of

Materials = Mapping[str, Material]
Pose = tuple[Vector3, Quaternion]

THIN_M = 1e-3
"""At least as thick is the box around a flat mesh."""


class ScriptedActor:
    """An actor that goes its own way."""

    def __init__(
        self,
        engine: Engine,
        actor: Actor,
        mover: motion.Mover,
        materials: Materials,
        tick: int,
    ) -> None:
        self._engine, self._mover = engine, mover
        self._then = place = mover.at(tick * TICK_SECONDS)
        solids = _boxed(parts(actor.form))
        self.body = body_of(engine, solids, place.position_m, place.orientation)
        # Of a body of several materials the engine knows one friction: its first part's.
        friction = materials[solids[0].material].friction
        engine.changeDynamics(self.body, -1, lateralFriction=friction, restitution=1.0)
        engine.setCollisionFilterGroupMask(self.body, -1, SCRIPTED, COLLIDES_WITH[SCRIPTED])
        self._rests = True

    @property
    def position_m(self) -> Vector3:
        """Its origin in the world."""
        return self._then.position_m

    def act(self, tick: int) -> None:
        """Set out for where it is a tick later."""
        now, then = self._then, self._mover.at((tick + 1) * TICK_SECONDS)
        self._then = then
        rests = now == then
        if rests and self._rests:
            return
        self._rests = rests
        x, y, z = (
            (b - a) / TICK_SECONDS for a, b in zip(now.position_m, then.position_m, strict=True)
        )
        turn = (then.yaw_rad - now.yaw_rad + np.pi) % (2 * np.pi) - np.pi
        engine = self._engine
        engine.resetBasePositionAndOrientation(self.body, now.position_m, now.orientation)
        engine.resetBaseVelocity(self.body, (x, y, z), (0.0, 0.0, turn / TICK_SECONDS))

    def pose(self) -> Pose:
        """Return world_from_actor after the last step."""
        return self._then.position_m, self._then.orientation


class FreeActor:
    """An actor that falls, rests and is pushed about."""

    def __init__(self, engine: Engine, actor: Actor, free: Free, place: motion.Place) -> None:
        self._engine = engine
        solids = _boxed(parts(actor.form))
        corners = np.array([bounds(solid) for solid in solids])
        low, high = corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)
        self._middle = (low + high) / 2
        """Its center of mass, in its own frame."""

        self.reach_m = float(np.linalg.norm(np.maximum(-low, high)))
        self.body = body_of(
            engine,
            solids,
            place.position_m,
            place.orientation,
            mass_kg=free.mass_kg,
            center_m=tuple(self._middle.tolist()),
        )
        engine.changeDynamics(
            self.body,
            -1,
            lateralFriction=free.friction,
            restitution=free.restitution,
            linearDamping=0,
            angularDamping=0,
        )
        engine.setCollisionFilterGroupMask(self.body, -1, FREE, COLLIDES_WITH[FREE])

    @property
    def position_m(self) -> Vector3:
        """Its origin in the world."""
        return self.pose()[0]

    def act(self, tick: int) -> None:
        """Do nothing: it is acted upon."""

    def pose(self) -> Pose:
        """Return world_from_actor after the last step."""
        center, orientation = self._engine.getBasePositionAndOrientation(self.body)
        origin = center - matrix_from_quaternion(orientation) @ self._middle
        x, y, z = origin.tolist()
        return (x, y, z), orientation


def put(
    engine: Engine, actor: Actor, ground: Ground | None, materials: Materials, tick: int
) -> ScriptedActor | FreeActor:
    """Put an actor into the engine, where it is at a tick."""
    if isinstance(actor.motion, Free):
        return FreeActor(engine, actor, actor.motion, motion.start(actor.motion, ground))
    return ScriptedActor(engine, actor, motion.mover(actor.motion, ground), materials, tick)


def _boxed(solids: Sequence[Solid]) -> list[Solid]:
    """Return solids with boxes in the place of meshes."""
    return [
        replace(
            solid,
            shape=_box(solid.shape),
            position_m=tuple(middle(solid).tolist()),
        )
        if isinstance(solid.shape, Mesh)
        else solid
        for solid in solids
    ]


def _box(mesh: Mesh) -> Box:
    x, y, z = (2 * half_extents(mesh)).tolist()
    return Box(size_m=(max(x, THIN_M), max(y, THIN_M), max(z, THIN_M)))
