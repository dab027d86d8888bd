# SPDX-License-Identifier: Apache-2.0
"""The backend that runs PyBullet. Every call carries the client id of its world."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from groundlink.core.clock import TICK_SECONDS
from groundlink.core.errors import UserError
from groundlink.core.fields import Vector3
from groundlink.core.frames import IDENTITY_QUATERNION
from groundlink.world.mesh_asset import load_mesh as mesh_surface
from groundlink.world.solids import Box, Cylinder, Mesh, Shape, Solid, Sphere

from .backend import (
    BASE,
    COLLIDES_WITH,
    GRAVITY_MPS2,
    TERRAIN,
    ContactPoint,
    Heights,
    Pose,
    Surface,
)


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep what the C library prints while it loads (its build time) from the user's terminal."""
    sys.stderr.flush()
    kept = os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


with _quiet():
    import pybullet

SOLVER_ITERATIONS = 20
"""Iterations of the contact solver in each step; motion on springs is the same from 10 on."""

MAX_TRIANGLES = 2_000_000
"""Triangles of a mesh; a million takes 4 s and 0.3 GB."""

COLLISION_MARGIN_M = 0.001
"""Distance from triangles at which Bullet looks for contacts. With 0, bodies that rest on level
triangles are dropped at times."""

_ORIGIN = (0.0, 0.0, 0.0)

_STL_HEADER_BYTES = 80
_STL_FACE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])


class BulletBackend:
    """A PyBullet world in this process."""

    def __init__(self) -> None:
        self._client: int = pybullet.connect(pybullet.DIRECT)
        self.set_gravity((0.0, 0.0, -GRAVITY_MPS2))
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=TICK_SECONDS,
            numSolverIterations=SOLVER_ITERATIONS,
            # Without it the order of contact pairs, and so the motion, may differ between runs.
            deterministicOverlappingPairs=1,
            # The cache of files goes by name alone and lasts as long as the process.
            enableFileCaching=0,
            # Depth that contacts leave unopposed; with 0, a vehicle put down stays put.
            contactSlop=0,
            physicsClientId=self._client,
        )
        # Without a visual shape Bullet keeps all triangles of a body a second time, to draw them.
        self._invisible: int = pybullet.createVisualShape(
            pybullet.GEOM_SPHERE, radius=0.001, physicsClientId=self._client
        )
        self._mesh_shapes: dict[str, int] = {}
        self._heightfields: dict[int, tuple[int, float]] = {}
        """Shape and cell size by body."""

    def set_gravity(self, gravity_mps2: Vector3) -> None:
        """Set the acceleration of gravity in the world frame."""
        pybullet.setGravity(*gravity_mps2, physicsClientId=self._client)

    def add_body(
        self,
        solids: Sequence[Solid],
        surface: Surface,
        pose: Pose | None = None,
        *,
        mass_kg: float = 0.0,
        center_m: Vector3 = _ORIGIN,
    ) -> int:
        """Add solids as one rigid body and return it."""
        shape, at = self._shape(solids) if pose is None else (self._compound(solids), pose)
        is_mesh = isinstance(solids[0].shape, Mesh)
        body: int = pybullet.createMultiBody(
            baseMass=mass_kg,
            baseCollisionShapeIndex=shape,
            baseVisualShapeIndex=self._invisible if is_mesh else -1,
            basePosition=at[0],
            baseOrientation=at[1],
            baseInertialFramePosition=center_m,
            physicsClientId=self._client,
        )
        margin = {"collisionMargin": COLLISION_MARGIN_M} if is_mesh else {}
        damping = {"linearDamping": 0, "angularDamping": 0} if mass_kg else {}
        if margin or damping:
            self._change(body, BASE, **margin, **damping)
        self.set_surface(body, surface)
        return body

    def _shape(self, solids: Sequence[Solid]) -> tuple[int, Pose]:
        """Return a shape for solids in the world frame, and the pose of the body that has it."""
        if len(solids) > 1:
            return self._compound(solids), (_ORIGIN, IDENTITY_QUATERNION)
        [solid] = solids
        at = solid.position_m, solid.orientation
        if isinstance(solid.shape, Mesh):
            return self._mesh_shape(solid.name, solid.shape), at
        kind, half_extents, radius, length = _primitive(solid.shape)
        shape: int = pybullet.createCollisionShape(
            kind,
            halfExtents=half_extents,
            radius=radius,
            height=length,
            physicsClientId=self._client,
        )
        return shape, at

    def _compound(self, solids: Sequence[Solid]) -> int:
        kinds, halves, radii, lengths = zip(*(_primitive(s.shape) for s in solids), strict=True)
        shape: int = pybullet.createCollisionShapeArray(
            shapeTypes=kinds,
            halfExtents=halves,
            radii=radii,
            lengths=lengths,
            collisionFramePositions=[solid.position_m for solid in solids],
            collisionFrameOrientations=[solid.orientation for solid in solids],
            physicsClientId=self._client,
        )
        return shape

    def _mesh_shape(self, name: str, mesh: Mesh) -> int:
        """Return the shape of a hollow mesh with all of its triangles; each mesh is kept once.

        Meshes go to Bullet through a file: as arguments it takes 131,072 vertices at most. An STL
        file takes half as long to read as an OBJ file.
        """
        if (known := self._mesh_shapes.get(mesh.asset)) is not None:
            return known
        found = mesh_surface(mesh.asset)
        if len(found.faces) > MAX_TRIANGLES:
            raise UserError(
                f"mesh `{name}`: {len(found.faces):,} triangles are too many for physics; expected "
                f"at most {MAX_TRIANGLES:,}. Fix: simplify the mesh before importing it"
            )
        faces = np.zeros(len(found.faces), _STL_FACE)
        faces["corners"] = found.vertices[found.faces]
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder, "mesh.stl")
            count = np.uint32(len(faces)).tobytes()
            file.write_bytes(bytes(_STL_HEADER_BYTES) + count + faces.tobytes())
            shape: int = pybullet.createCollisionShape(
                pybullet.GEOM_MESH,
                fileName=str(file),
                # Without internal edges, level triangles push what rolls over their borders.
                flags=pybullet.GEOM_FORCE_CONCAVE_TRIMESH | pybullet.GEOM_CONCAVE_INTERNAL_EDGE,
                physicsClientId=self._client,
            )
        self._mesh_shapes[mesh.asset] = shape
        return shape

    def add_heightfield(
        self, touching: int, heights: Heights, cell_m: float, friction: float
    ) -> int:
        """Add a square heightfield that touches only one other body; return its body."""
        shape = self._heightfield_shape(heights, cell_m)
        body: int = pybullet.createMultiBody(
            0, shape, self._invisible, physicsClientId=self._client
        )
        self._heightfields[body] = shape, cell_m
        self._change(body, BASE, collisionMargin=COLLISION_MARGIN_M)
        self.set_surface(body, Surface(friction, 1.0, TERRAIN))
        for link in range(-1, pybullet.getNumJoints(touching, physicsClientId=self._client)):
            pybullet.setCollisionFilterPair(
                touching, body, link, BASE, 1, physicsClientId=self._client
            )
        return body

    def set_heights(self, body: int, heights: Heights, position_m: Vector3) -> None:
        """Replace the heights of a heightfield and move its origin."""
        shape, cell_m = self._heightfields[body]
        self._heightfield_shape(heights, cell_m, replaceHeightfieldIndex=shape)
        self.set_pose(body, (position_m, IDENTITY_QUATERNION))

    def _heightfield_shape(self, heights: Heights, cell_m: float, **replaced: int) -> int:
        rows, columns = heights.shape
        shape: int = pybullet.createCollisionShape(
            pybullet.GEOM_HEIGHTFIELD,
            meshScale=(cell_m, cell_m, 1.0),
            heightfieldData=heights.ravel(),
            # Bullet counts along x first.
            numHeightfieldRows=columns,
            numHeightfieldColumns=rows,
            # Without it a level edge pushes a wheel that rolls over it: 0.3 m/s2, not 0.005.
            flags=pybullet.GEOM_CONCAVE_INTERNAL_EDGE,
            physicsClientId=self._client,
            **replaced,
        )
        return shape

    def add_articulated(
        self, urdf: str, files: Mapping[str, str], pose: Pose
    ) -> tuple[int, dict[str, int]]:
        """Add a body described in URDF; return it and its joints by name."""
        with tempfile.TemporaryDirectory() as folder:
            for name, content in {"body.urdf": urdf, **files}.items():
                Path(folder, name).write_text(content)
            body: int = pybullet.loadURDF(
                str(Path(folder, "body.urdf")),
                *pose,
                flags=pybullet.URDF_USE_INERTIA_FROM_FILE | pybullet.URDF_USE_IMPLICIT_CYLINDER,
                physicsClientId=self._client,
            )
        joints = {
            pybullet.getJointInfo(body, joint, physicsClientId=self._client)[1].decode(): joint
            for joint in range(pybullet.getNumJoints(body, physicsClientId=self._client))
        }
        for link in (BASE, *joints.values()):
            # Bullet would damp every motion by 4 % a second; what it damps more is not linear.
            self._change(body, link, linearDamping=0, angularDamping=0, jointDamping=0)
        # Bullet's joints come with motors that hold them.
        pybullet.setJointMotorControlArray(
            body,
            list(joints.values()),
            pybullet.VELOCITY_CONTROL,
            forces=[0] * len(joints),
            physicsClientId=self._client,
        )
        return body, joints

    def remove(self, body: int) -> None:
        """Remove a body."""
        pybullet.removeBody(body, physicsClientId=self._client)

    def set_surface(self, body: int, surface: Surface, link: int = BASE) -> None:
        """Set the contact properties of a link."""
        friction, restitution, group = surface
        self._change(body, link, lateralFriction=friction, restitution=restitution)
        pybullet.setCollisionFilterGroupMask(
            body, link, group, COLLIDES_WITH[group], physicsClientId=self._client
        )

    def set_friction(self, body: int, friction: float) -> None:
        """Set the friction of a body's base."""
        self._change(body, BASE, lateralFriction=friction)

    def _change(self, body: int, link: int, **dynamics: float) -> None:
        pybullet.changeDynamics(body, link, physicsClientId=self._client, **dynamics)

    def pose(self, body: int) -> Pose:
        """Return the pose of a body's base."""
        pose: Pose = pybullet.getBasePositionAndOrientation(body, physicsClientId=self._client)
        return pose

    def velocity(self, body: int) -> tuple[Vector3, Vector3]:
        """Return linear (m/s) and angular velocity (rad/s) of a body's base."""
        velocity: tuple[Vector3, Vector3] = pybullet.getBaseVelocity(
            body, physicsClientId=self._client
        )
        return velocity

    def set_pose(self, body: int, pose: Pose) -> None:
        """Move a body."""
        pybullet.resetBasePositionAndOrientation(body, *pose, physicsClientId=self._client)

    def set_velocity(self, body: int, linear_mps: Vector3, angular_radps: Vector3) -> None:
        """Set the velocity of a body's base."""
        pybullet.resetBaseVelocity(body, linear_mps, angular_radps, physicsClientId=self._client)

    def push(self, body: int, force_n: Vector3, torque_nm: Vector3) -> None:
        """Apply a force at the center of mass and a torque for one step, in the base's frame."""
        client, frame = self._client, pybullet.LINK_FRAME
        pybullet.applyExternalForce(body, BASE, force_n, _ORIGIN, frame, physicsClientId=client)
        pybullet.applyExternalTorque(body, BASE, torque_nm, frame, physicsClientId=client)

    def joint_states(self, body: int, joints: Sequence[int]) -> Sequence[Sequence[float]]:
        """Return position (m) and velocity (m/s) of joints; a row may have more columns."""
        states: Sequence[Any] = pybullet.getJointStates(body, joints, physicsClientId=self._client)
        return states

    def set_joint_positions(
        self, body: int, joints: Sequence[int], positions_m: Sequence[float]
    ) -> None:
        """Move joints and take their velocity away."""
        for joint, position in zip(joints, positions_m, strict=True):
            pybullet.resetJointState(body, joint, position, 0.0, physicsClientId=self._client)

    def set_joint_forces(self, body: int, joints: Sequence[int], forces_n: Sequence[float]) -> None:
        """Apply forces along joints for one step."""
        pybullet.setJointMotorControlArray(
            body, joints, pybullet.TORQUE_CONTROL, forces=forces_n, physicsClientId=self._client
        )

    def contacts(self, body: int) -> list[ContactPoint]:
        """Return the contact points of the last step that carry a force."""
        found = pybullet.getContactPoints(body, physicsClientId=self._client)
        return [(c[2], c[3], c[6], c[7], c[9]) for c in found if c[9] > 0.0]

    def ray(self, start_m: Vector3, end_m: Vector3) -> tuple[int, Vector3] | None:
        """Return the first body on a line and where the line meets it; None for no body."""
        [(body, _, _, point, _)] = pybullet.rayTest(start_m, end_m, physicsClientId=self._client)
        return None if body < 0 else (body, point)

    def step(self) -> None:
        """Advance by one tick."""
        pybullet.stepSimulation(physicsClientId=self._client)

    def close(self) -> None:
        """Free the world; nothing can be called after it but `close`."""
        if self._client >= 0:
            pybullet.disconnect(physicsClientId=self._client)
            self._client = -1


def _primitive(shape: Shape) -> tuple[int, list[float], float, float]:
    """Return a shape's type, half extents, radius and length, as PyBullet takes them."""
    if isinstance(shape, Box):
        return pybullet.GEOM_BOX, [length / 2 for length in shape.size_m], 0.0, 0.0
    if isinstance(shape, Cylinder):
        return pybullet.GEOM_CYLINDER, [0.0, 0.0, 0.0], shape.radius_m, shape.length_m
    assert isinstance(shape, Sphere)  # a mesh has a body of its own
    return pybullet.GEOM_SPHERE, [0.0, 0.0, 0.0], shape.radius_m, 0.0
