# SPDX-License-Identifier: Apache-2.0
"""A backend without contacts: bodies follow gravity and forces; joints stay where they are set."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np

from groundlink.core.clock import TICK_SECONDS
from groundlink.core.fields import Vector3
from groundlink.core.frames import IDENTITY_QUATERNION, matrix_from_quaternion
from groundlink.world.solids import Solid
from services.physics.dynamics.backend import (
    BASE,
    GRAVITY_MPS2,
    TERRAIN,
    Heights,
    Pose,
    Surface,
)
from services.physics.dynamics.bodies import ArticulatedBody, BodyList, ContactPoint, Contacts

_ZERO = (0.0, 0.0, 0.0)


@dataclass
class Body:
    """A body and what was set of it."""

    pose: Pose
    mass_kg: float
    surfaces: dict[int, Surface]
    linear_mps: Vector3 = _ZERO
    angular_radps: Vector3 = _ZERO
    force_n: Vector3 = _ZERO
    heights: Heights | None = None


class FreeBodies:
    """Implements `Backend` for tests that need no contact.

    Attributes
    ----------
    touching
        contact points that `contacts` returns.
    """

    def __init__(self) -> None:
        self.bodies: dict[int, Body] = {}
        self.touching: list[ContactPoint] = []
        self._joints: dict[int, dict[int, tuple[float, float]]] = {}
        self._count = 0

    def _add(self, body: Body) -> int:
        self._count += 1
        self.bodies[self._count] = body
        return self._count

    def add_body(
        self,
        solids: Sequence[Solid],
        surface: Surface,
        pose: Pose | None = None,
        *,
        mass_kg: float = 0.0,
        center_m: Vector3 = _ZERO,
    ) -> int:
        position, orientation = pose or (_ZERO, IDENTITY_QUATERNION)
        center = np.add(position, matrix_from_quaternion(orientation) @ center_m)
        x, y, z = center.tolist()
        return self._add(Body(((x, y, z), orientation), mass_kg, {BASE: surface}))

    def add_heightfield(
        self, touching: int, heights: Heights, cell_m: float, friction: float
    ) -> int:
        surface = Surface(friction, 1.0, TERRAIN)
        pose = _ZERO, IDENTITY_QUATERNION
        return self._add(Body(pose, 0.0, {BASE: surface}, heights=heights))

    def set_heights(self, body: int, heights: Heights, position_m: Vector3) -> None:
        self.bodies[body].heights = heights
        self.set_pose(body, (position_m, IDENTITY_QUATERNION))

    def add_articulated(
        self, urdf: str, files: Mapping[str, str], joints: Sequence[str], pose: Pose
    ) -> ArticulatedBody:
        robot = ElementTree.fromstring(urdf)
        mass_kg = sum(float(mass.attrib["value"]) for mass in robot.iter("mass"))
        body = self._add(Body(pose, mass_kg, {}))
        names = [joint.attrib["name"] for joint in robot.iter("joint")]
        self._joints[body] = dict.fromkeys(range(len(names)), (0.0, 0.0))
        return ArticulatedBody(body, [(names.index(name), 0, 0) for name in joints])

    def remove(self, body: int) -> None:
        del self.bodies[body]

    def set_surface(self, body: int, surface: Surface, link: int = BASE) -> None:
        self.bodies[body].surfaces[link] = surface

    def set_friction(self, body: int, friction: float) -> None:
        surfaces = self.bodies[body].surfaces
        surfaces[BASE] = surfaces[BASE]._replace(friction=friction)

    def pose(self, body: int) -> Pose:
        return self.bodies[body].pose

    def velocity(self, body: int) -> tuple[Vector3, Vector3]:
        return self.bodies[body].linear_mps, self.bodies[body].angular_radps

    def set_pose(self, body: int, pose: Pose) -> None:
        self.bodies[body].pose = pose

    def set_velocity(self, body: int, linear_mps: Vector3, angular_radps: Vector3) -> None:
        self.bodies[body].linear_mps = linear_mps
        self.bodies[body].angular_radps = angular_radps

    def set_joint_states(
        self, body: ArticulatedBody, states: Sequence[tuple[float, float]]
    ) -> None:
        links = [joint.link for joint in body.joints]
        self._joints[body.number] |= dict(zip(links, states, strict=True))

    def sense(self, bodies: BodyList) -> None:
        for it in bodies.bodies:
            body, joints = self.bodies[it.number], self._joints[it.number]
            it.center_m[:], it.orientation[:] = body.pose
            it.velocity_mps[:], it.turn_radps[:] = body.linear_mps, body.angular_radps
            for joint in it.joints:
                joint.position_m, joint.velocity_mps = joints[joint.link]

    def push(self, bodies: BodyList) -> None:
        for it in bodies.bodies:
            x, y, z = it.force_n
            self.bodies[it.number].force_n = x, y, z

    def contacts(self) -> Contacts:
        return Contacts((ContactPoint * len(self.touching))(*self.touching), len(self.touching))

    def ray(self, start_m: Vector3, end_m: Vector3) -> tuple[int, Vector3] | None:
        return None

    def step(self) -> None:
        for body in self.bodies.values():
            if not body.mass_kg:
                continue
            position, orientation = body.pose
            force = matrix_from_quaternion(orientation) @ body.force_n
            acceleration = force / body.mass_kg - np.array([0.0, 0.0, GRAVITY_MPS2])
            linear = np.add(body.linear_mps, TICK_SECONDS * acceleration)
            vx, vy, vz = linear.tolist()
            x, y, z = np.add(position, TICK_SECONDS * linear).tolist()
            body.linear_mps, body.pose, body.force_n = (vx, vy, vz), ((x, y, z), orientation), _ZERO

    def close(self) -> None:
        """Do nothing."""
