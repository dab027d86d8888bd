# SPDX-License-Identifier: Apache-2.0
"""A backend without contacts: bodies with mass follow gravity and forces, joints stay where set."""

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
    ContactPoint,
    Heights,
    Pose,
    Surface,
)

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
        contact points that `contacts` returns, by body.
    """

    def __init__(self) -> None:
        self.bodies: dict[int, Body] = {}
        self.touching: dict[int, list[ContactPoint]] = {}
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
        self, urdf: str, files: Mapping[str, str], pose: Pose
    ) -> tuple[int, dict[str, int]]:
        robot = ElementTree.fromstring(urdf)
        mass_kg = sum(float(mass.attrib["value"]) for mass in robot.iter("mass"))
        body = self._add(Body(pose, mass_kg, {}))
        names = [joint.attrib["name"] for joint in robot.iter("joint")]
        self._joints[body] = dict.fromkeys(range(len(names)), (0.0, 0.0))
        return body, {name: joint for joint, name in enumerate(names)}

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

    def push(self, body: int, force_n: Vector3, torque_nm: Vector3) -> None:
        self.bodies[body].force_n = force_n

    def joint_states(self, body: int, joints: Sequence[int]) -> Sequence[Sequence[float]]:
        return [self._joints[body][joint] for joint in joints]

    def set_joint_states(
        self, body: int, joints: Sequence[int], states: Sequence[tuple[float, float]]
    ) -> None:
        self._joints[body] |= dict(zip(joints, states, strict=True))

    def set_joint_forces(self, body: int, joints: Sequence[int], forces_n: Sequence[float]) -> None:
        """Do nothing: joints stay where they were set."""

    def contacts(self, body: int) -> list[ContactPoint]:
        return self.touching.get(body, [])

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
