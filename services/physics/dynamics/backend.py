# SPDX-License-Identifier: Apache-2.0
"""Interface to a physics engine: bodies, joints, forces and contacts.

`bullet` implements it with PyBullet. A body is a number that the backend hands out, a link is an
index within a body. Poses and velocities are those of a body's center of mass in the world frame.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from groundlink.core.fields import Quaternion, Vector3
from groundlink.world.solids import Solid

from .bodies import ArticulatedBody, BodyList, Contacts

RAY, GROUND, OBSTACLE, CHASSIS, WHEEL, TERRAIN, SCRIPTED, FREE = (1 << bit for bit in range(8))
"""Collision groups. Rays of the engine belong to the first one."""

COLLIDES_WITH = {
    GROUND: RAY | CHASSIS | WHEEL | FREE,
    OBSTACLE: RAY | CHASSIS | FREE,
    CHASSIS: RAY | GROUND | OBSTACLE | CHASSIS | SCRIPTED | FREE,
    WHEEL: RAY | GROUND,
    TERRAIN: RAY,
    SCRIPTED: RAY | CHASSIS | FREE,
    FREE: RAY | GROUND | OBSTACLE | CHASSIS | SCRIPTED | FREE,
}

GRAVITY_MPS2 = 9.80665
"""Standard gravity (CGPM 1901), along -z of the world."""

MAX_SOLIDS = 16
"""Solids of one body: PyBullet's MAX_COMPOUND_COLLISION_SHAPES."""

BASE = -1
"""Link index of a body's base."""

Heights = NDArray[np.float32]
Pose = tuple[Vector3, Quaternion]
Twist = tuple[Vector3, Vector3]
"""Linear (m/s) and angular (rad/s) velocity."""


class Surface(NamedTuple):
    """Contact properties of a body or a link. The engine multiplies those of two surfaces."""

    friction: float
    restitution: float
    group: int


class Backend(Protocol):
    """A world of its own. A step takes one tick, gravity acts along -z."""

    def add_body(
        self,
        solids: Sequence[Solid],
        surface: Surface,
        pose: Pose | None = None,
        *,
        mass_kg: float = 0.0,
        center_m: Vector3 = (0.0, 0.0, 0.0),
    ) -> int:
        """Add solids as one rigid body and return it.

        Parameters
        ----------
        pose
            world_from_body, with the solids in the body's frame; None: solids in the world frame,
            or a single mesh.
        mass_kg, center_m
            mass and center of mass in the body's frame; a body without mass moves only when it is
            set to move.

        Raises
        ------
        UserError
            when a mesh has too many triangles.
        """

    def add_heightfield(
        self, touching: int, heights: Heights, cell_m: float, friction: float
    ) -> int:
        """Add a square heightfield that touches only one other body; return its body.

        Parameters
        ----------
        heights
            shape (side, side), m. The engine keeps z = 0 halfway between the lowest and the highest
            of these heights, whatever `set_heights` is given later.
        """

    def set_heights(self, body: int, heights: Heights, position_m: Vector3) -> None:
        """Replace the heights of a heightfield and move its origin."""

    def add_articulated(
        self, urdf: str, files: Mapping[str, str], joints: Sequence[str], pose: Pose
    ) -> ArticulatedBody:
        """Add a body described in URDF; return it with joints in the order of their names.

        Nothing damps its motion and no motor holds its joints.

        Parameters
        ----------
        files
            contents of the files that the document refers to, by name.
        """

    def couple(self, body: int, at_m: Vector3, other: int, other_at_m: Vector3) -> int:
        """Hold two points of bodies' bases together by a ball joint, and return the joint.

        Parameters
        ----------
        at_m, other_at_m
            from the centers of mass, in the bases' frames.
        """

    def uncouple(self, joint: int) -> None:
        """Remove a ball joint, before its bodies."""

    def remove(self, body: int) -> None:
        """Remove a body."""

    def set_surface(self, body: int, surface: Surface, link: int = BASE) -> None:
        """Set the contact properties of a link."""

    def set_friction(self, body: int, friction: float) -> None:
        """Set the friction of a body's base."""

    def set_contact_spring(self, body: int, stiffness_npm: float, damping_nspm: float) -> None:
        """Make each contact point of a body's base a spring with a damper."""

    def pose(self, body: int) -> Pose:
        """Return the pose of a body's base."""

    def velocity(self, body: int) -> tuple[Vector3, Vector3]:
        """Return linear (m/s) and angular velocity (rad/s) of a body's base."""

    def set_pose(self, body: int, pose: Pose) -> None:
        """Move a body."""

    def set_velocity(self, body: int, linear_mps: Vector3, angular_radps: Vector3) -> None:
        """Set the velocity of a body's base."""

    def set_joint_states(
        self, body: ArticulatedBody, states: Sequence[tuple[float, float]]
    ) -> None:
        """Set position (m) and velocity (m/s) of all joints of a body."""

    def sense(self, bodies: BodyList) -> None:
        """Read the motion of bodies and their joints."""

    def push(self, bodies: BodyList) -> None:
        """Apply the forces of bodies and their joints for one step."""

    def contacts(self) -> Contacts:
        """Return the contact points of the last step that carry a force, until the next call."""

    def ray(self, start_m: Vector3, end_m: Vector3) -> tuple[int, Vector3] | None:
        """Return the first body on a line and where the line meets it; None for no body."""

    def step(self) -> None:
        """Advance by one tick."""

    def close(self) -> None:
        """Free the world; nothing can be called after it but `close`."""
