# SPDX-License-Identifier: Apache-2.0
"""Actors in the backend: scripted ones, which follow a motion, and free ones, which are pushed.

A scripted actor is exactly where its motion says at every tick; its body has the velocity to the
next pose, so that contacts push. Wheels touch no actor: as with obstacles, chassis do. A mesh
counts as the box around it.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from msgspec.structs import replace

from groundlink.core.clock import TICK_SECONDS
from groundlink.core.fields import Vector3
from groundlink.core.frames import matrix_from_quaternion
from groundlink.world import actor_motion as motion
from groundlink.world.actors import Actor, FreeMotion, form_solids
from groundlink.world.bounds import bounds, half_extents, middle
from groundlink.world.solids import Box, Material, Mesh, Solid
from groundlink.world.terrain import Ground
from services.physics.dynamics.backend import FREE, SCRIPTED, Backend, Pose, Surface, Twist

Materials = Mapping[str, Material]

THIN_M = 1e-3
"""Least thickness of the box around a flat mesh."""


class ScriptedActor:
    """An actor that follows a motion, whatever it meets."""

    def __init__(
        self, backend: Backend, actor: Actor, mover: motion.Mover, materials: Materials, tick: int
    ) -> None:
        self._backend, self._mover = backend, mover
        self._then = mover.at(tick * TICK_SECONDS)
        solids = _boxed(form_solids(actor.form))
        # A body has one friction: that of its first part.
        friction = materials[solids[0].material].friction
        self.body = backend.add_body(solids, Surface(friction, 1.0, SCRIPTED), self.pose())
        self._rests = True

    @property
    def position_m(self) -> Vector3:
        """Its origin in the world."""
        return self._then.position_m

    def act(self, tick: int) -> None:
        """Set the velocity that leads to the pose one tick later."""
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
        self._backend.set_pose(self.body, (now.position_m, now.orientation))
        self._backend.set_velocity(self.body, (x, y, z), (0.0, 0.0, turn / TICK_SECONDS))

    def pose(self) -> Pose:
        """Return world_from_actor after the last step."""
        return self._then.position_m, self._then.orientation

    def twist(self) -> Twist:
        """Return the velocity of its origin in the last step."""
        return self._backend.velocity(self.body)


class FreeActor:
    """An actor that falls, rests and is pushed about."""

    def __init__(
        self, backend: Backend, actor: Actor, free: FreeMotion, place: motion.ActorPose
    ) -> None:
        self._backend = backend
        solids = _boxed(form_solids(actor.form))
        corners = np.array([bounds(solid) for solid in solids])
        low, high = corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)
        self._middle = (low + high) / 2
        """Its center of mass, in its own frame."""

        self.reach_m = float(np.linalg.norm(np.maximum(-low, high)))
        self.body = backend.add_body(
            solids,
            Surface(free.friction, free.restitution, FREE),
            (place.position_m, place.orientation),
            mass_kg=free.mass_kg,
            center_m=tuple(self._middle.tolist()),
        )

    @property
    def position_m(self) -> Vector3:
        """Its origin in the world."""
        return self.pose()[0]

    def act(self, tick: int) -> None:
        """Do nothing: only contacts and gravity move it."""

    def pose(self) -> Pose:
        """Return world_from_actor after the last step."""
        center, orientation = self._backend.pose(self.body)
        origin = center - matrix_from_quaternion(orientation) @ self._middle
        x, y, z = origin.tolist()
        return (x, y, z), orientation

    def twist(self) -> Twist:
        """Return the velocity of its origin after the last step."""
        linear, angular = self._backend.velocity(self.body)
        arm = matrix_from_quaternion(self._backend.pose(self.body)[1]) @ self._middle
        vx, vy, vz = (linear - np.cross(angular, arm)).tolist()
        return (vx, vy, vz), angular

    def place(self, pose: Pose | None, twist: Twist | None) -> None:
        """Set pose or velocity of its origin; None: unchanged."""
        origin, orientation = pose or self.pose()
        linear, angular = twist or self.twist()
        arm = matrix_from_quaternion(orientation) @ self._middle
        x, y, z = (origin + arm).tolist()
        vx, vy, vz = (linear + np.cross(angular, arm)).tolist()
        self._backend.set_pose(self.body, ((x, y, z), orientation))
        self._backend.set_velocity(self.body, (vx, vy, vz), angular)


def put(
    backend: Backend, actor: Actor, ground: Ground | None, materials: Materials, tick: int
) -> ScriptedActor | FreeActor:
    """Add an actor to a backend, where it is at a tick."""
    if isinstance(actor.motion, FreeMotion):
        return FreeActor(backend, actor, actor.motion, motion.initial_pose(actor.motion, ground))
    return ScriptedActor(backend, actor, motion.mover(actor.motion, ground), materials, tick)


def _boxed(solids: Sequence[Solid]) -> list[Solid]:
    """Return solids with boxes in the place of meshes."""
    return [
        replace(solid, shape=_box(solid.shape), position_m=tuple(middle(solid).tolist()))
        if isinstance(solid.shape, Mesh)
        else solid
        for solid in solids
    ]


def _box(mesh: Mesh) -> Box:
    x, y, z = (2 * half_extents(mesh)).tolist()
    return Box(size_m=(max(x, THIN_M), max(y, THIN_M), max(z, THIN_M)))
