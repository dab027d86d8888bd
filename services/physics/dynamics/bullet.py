# SPDX-License-Identifier: Apache-2.0
"""The backend that runs PyBullet. Each backend is a world of its own."""

import ctypes
import os
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from ctypes import byref
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from groundlink.core.clock import TICK_SECONDS
from groundlink.core.errors import RequirementError, UserError
from groundlink.core.fields import Vector3
from groundlink.core.frames import IDENTITY_QUATERNION
from groundlink.world.mesh_asset import load_mesh as mesh_surface
from groundlink.world.solids import Box, Cylinder, Mesh, Shape, Solid, Sphere

from .backend import (
    BASE,
    COLLIDES_WITH,
    GRAVITY_MPS2,
    TERRAIN,
    Heights,
    Pose,
    Surface,
)
from .bodies import ArticulatedBody, BodyList, Contacts
from .kernels import kernels, library_file


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

HITCH_N = 1e6
"""Largest force of a ball joint; Bullet's own default gives way at 500 N."""

MAX_TRIANGLES = 2_000_000
"""Triangles of a mesh; a million takes 4 s and 0.3 GB."""

COLLISION_MARGIN_M = 0.001
"""Distance from triangles at which Bullet looks for contacts. With 0, bodies that rest on level
triangles are dropped at times."""

_ORIGIN = (0.0, 0.0, 0.0)

_STL_HEADER_BYTES = 80
_STL_FACE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])


class _Client:
    """PyBullet's functions, bound to a world of their own."""

    def __init__(self) -> None:
        self._id: int = pybullet.connect(pybullet.DIRECT)

    def __getattr__(self, name: str) -> Any:
        bound = self.__dict__[name] = partial(getattr(pybullet, name), physicsClientId=self._id)
        return bound

    def close(self) -> None:
        if self._id >= 0:
            self.disconnect()
            self._id = -1


def _world(client: _Client) -> int:
    """Return the C API's handle of a world; see `bullet.c`."""
    if missing := kernels().bullet_bind(ctypes.CDLL(pybullet.__file__)._handle):
        raise RequirementError(
            f"PyBullet here has no `{missing.decode()}`. Fix: pip install 'groundlink[physics]'"
        )
    if client.loadPlugin(library_file(), "_groundlink") < 0:
        raise RequirementError(
            "PyBullet here is of another version. Fix: pip install 'groundlink[physics]'"
        )
    world: int = kernels().bullet_world()
    return world


class BulletBackend:
    """A PyBullet world in this process; `Backend` documents its methods."""

    def __init__(self) -> None:
        self._bullet = _Client()
        self._kernels, self._world = kernels(), _world(self._bullet)
        self._contacts = Contacts()
        self.set_gravity((0.0, 0.0, -GRAVITY_MPS2))
        self._bullet.setPhysicsEngineParameter(
            fixedTimeStep=TICK_SECONDS,
            numSolverIterations=SOLVER_ITERATIONS,
            # Without it the order of contact pairs, and so the motion, may differ between runs.
            deterministicOverlappingPairs=1,
            # The cache of files goes by name alone and lasts as long as the process.
            enableFileCaching=0,
            # Depth that contacts leave unopposed; with 0, a vehicle put down stays put.
            contactSlop=0,
        )
        # Without a visual shape Bullet keeps all triangles of a body a second time, to draw them.
        self._invisible: int = self._bullet.createVisualShape(pybullet.GEOM_SPHERE, radius=0.001)
        self._mesh_shapes: dict[str, int] = {}
        self._heightfields: dict[int, tuple[int, float]] = {}
        """Shape and cell size by body."""

    def set_gravity(self, gravity_mps2: Vector3) -> None:
        """Set the acceleration of gravity in the world frame."""
        self._bullet.setGravity(*gravity_mps2)

    def add_body(
        self,
        solids: Sequence[Solid],
        surface: Surface,
        pose: Pose | None = None,
        *,
        mass_kg: float = 0.0,
        center_m: Vector3 = _ORIGIN,
    ) -> int:
        shape, at = self._shape(solids) if pose is None else (self._compound(solids), pose)
        is_mesh = isinstance(solids[0].shape, Mesh)
        body: int = self._bullet.createMultiBody(
            baseMass=mass_kg,
            baseCollisionShapeIndex=shape,
            baseVisualShapeIndex=self._invisible if is_mesh else -1,
            basePosition=at[0],
            baseOrientation=at[1],
            baseInertialFramePosition=center_m,
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
        shape: int = self._bullet.createCollisionShape(
            kind, halfExtents=half_extents, radius=radius, height=length
        )
        return shape, at

    def _compound(self, solids: Sequence[Solid]) -> int:
        kinds, halves, radii, lengths = zip(*(_primitive(s.shape) for s in solids), strict=True)
        shape: int = self._bullet.createCollisionShapeArray(
            shapeTypes=kinds,
            halfExtents=halves,
            radii=radii,
            lengths=lengths,
            collisionFramePositions=[solid.position_m for solid in solids],
            collisionFrameOrientations=[solid.orientation for solid in solids],
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
            shape: int = self._bullet.createCollisionShape(
                pybullet.GEOM_MESH,
                fileName=str(file),
                # Without internal edges, level triangles push what rolls over their borders.
                flags=pybullet.GEOM_FORCE_CONCAVE_TRIMESH | pybullet.GEOM_CONCAVE_INTERNAL_EDGE,
            )
        self._mesh_shapes[mesh.asset] = shape
        return shape

    def add_heightfield(
        self, touching: int, heights: Heights, cell_m: float, friction: float
    ) -> int:
        shape = self._heightfield_shape(heights, cell_m)
        body: int = self._bullet.createMultiBody(0, shape, self._invisible)
        self._heightfields[body] = shape, cell_m
        self._change(body, BASE, collisionMargin=COLLISION_MARGIN_M)
        self.set_surface(body, Surface(friction, 1.0, TERRAIN))
        for link in range(-1, self._bullet.getNumJoints(touching)):
            self._bullet.setCollisionFilterPair(touching, body, link, BASE, 1)
        return body

    def set_heights(self, body: int, heights: Heights, position_m: Vector3) -> None:
        shape, cell_m = self._heightfields[body]
        self._heightfield_shape(heights, cell_m, replaceHeightfieldIndex=shape)
        self.set_pose(body, (position_m, IDENTITY_QUATERNION))

    def _heightfield_shape(self, heights: Heights, cell_m: float, **replaced: int) -> int:
        rows, columns = heights.shape
        shape: int = self._bullet.createCollisionShape(
            pybullet.GEOM_HEIGHTFIELD,
            meshScale=(cell_m, cell_m, 1.0),
            heightfieldData=heights.ravel(),
            # Bullet counts along x first.
            numHeightfieldRows=columns,
            numHeightfieldColumns=rows,
            # Without it a level edge pushes a wheel that rolls over it: 0.3 m/s2, not 0.005.
            flags=pybullet.GEOM_CONCAVE_INTERNAL_EDGE,
            **replaced,
        )
        return shape

    def add_articulated(
        self, urdf: str, files: Mapping[str, str], joints: Sequence[str], pose: Pose
    ) -> ArticulatedBody:
        with tempfile.TemporaryDirectory() as folder:
            for name, content in {"body.urdf": urdf, **files}.items():
                Path(folder, name).write_text(content)
            body: int = self._bullet.loadURDF(
                str(Path(folder, "body.urdf")),
                *pose,
                flags=pybullet.URDF_USE_INERTIA_FROM_FILE | pybullet.URDF_USE_IMPLICIT_CYLINDER,
            )
        links = range(self._bullet.getNumJoints(body))
        for link in (BASE, *links):
            # Bullet would damp every motion by 4 % a second; what it damps more is not linear.
            self._change(body, link, linearDamping=0, angularDamping=0, jointDamping=0)
        # Bullet's joints come with motors that hold them.
        self._bullet.setJointMotorControlArray(
            body, links, pybullet.VELOCITY_CONTROL, forces=[0] * len(links)
        )
        # Number, name, type, and places in the vectors of positions and of velocities.
        found = [self._bullet.getJointInfo(body, link) for link in links]
        places = {info[1].decode(): (info[0], info[3], info[4]) for info in found}
        return ArticulatedBody(body, [places[name] for name in joints])

    def couple(self, body: int, at_m: Vector3, other: int, other_at_m: Vector3) -> int:
        joint: int = self._bullet.createConstraint(
            *(body, BASE, other, BASE, pybullet.JOINT_POINT2POINT),
            *(_ORIGIN, at_m, other_at_m),
        )
        self._bullet.changeConstraint(joint, maxForce=HITCH_N)
        return joint

    def uncouple(self, joint: int) -> None:
        self._bullet.removeConstraint(joint)

    def remove(self, body: int) -> None:
        self._bullet.removeBody(body)

    def set_surface(self, body: int, surface: Surface, link: int = BASE) -> None:
        friction, restitution, group = surface
        self._change(body, link, lateralFriction=friction, restitution=restitution)
        self._bullet.setCollisionFilterGroupMask(body, link, group, COLLIDES_WITH[group])

    def set_friction(self, body: int, friction: float) -> None:
        self._change(body, BASE, lateralFriction=friction)

    def set_contact_spring(self, body: int, stiffness_npm: float, damping_nspm: float) -> None:
        self._change(body, BASE, contactStiffness=stiffness_npm, contactDamping=damping_nspm)

    def _change(self, body: int, link: int, **dynamics: float) -> None:
        self._bullet.changeDynamics(body, link, **dynamics)

    def pose(self, body: int) -> Pose:
        pose: Pose = self._bullet.getBasePositionAndOrientation(body)
        return pose

    def velocity(self, body: int) -> tuple[Vector3, Vector3]:
        velocity: tuple[Vector3, Vector3] = self._bullet.getBaseVelocity(body)
        return velocity

    def set_pose(self, body: int, pose: Pose) -> None:
        self._bullet.resetBasePositionAndOrientation(body, *pose)

    def set_velocity(self, body: int, linear_mps: Vector3, angular_radps: Vector3) -> None:
        self._bullet.resetBaseVelocity(body, linear_mps, angular_radps)

    def set_joint_states(
        self, body: ArticulatedBody, states: Sequence[tuple[float, float]]
    ) -> None:
        for joint, state in zip(body.joints, states, strict=True):
            self._bullet.resetJointState(body.number, joint.link, *state)

    def sense(self, bodies: BodyList) -> None:
        self._kernels.bullet_sense(self._world, bodies.address, len(bodies.bodies))

    def push(self, bodies: BodyList) -> None:
        self._kernels.bullet_push(self._world, bodies.address, len(bodies.bodies))

    def contacts(self) -> Contacts:
        self._kernels.bullet_contacts(self._world, byref(self._contacts))
        return self._contacts

    def ray(self, start_m: Vector3, end_m: Vector3) -> tuple[int, Vector3] | None:
        [(body, _, _, point, _)] = self._bullet.rayTest(start_m, end_m)
        return None if body < 0 else (body, point)

    def step(self) -> None:
        self._kernels.bullet_step(self._world)

    def close(self) -> None:
        self._bullet.close()
        self._kernels.contacts_free(byref(self._contacts))


def _primitive(shape: Shape) -> tuple[int, list[float], float, float]:
    """Return a shape's type, half extents, radius and length, as PyBullet takes them."""
    if isinstance(shape, Box):
        return pybullet.GEOM_BOX, [length / 2 for length in shape.size_m], 0.0, 0.0
    if isinstance(shape, Cylinder):
        return pybullet.GEOM_CYLINDER, [0.0, 0.0, 0.0], shape.radius_m, shape.length_m
    assert isinstance(shape, Sphere)  # a mesh has a body of its own
    return pybullet.GEOM_SPHERE, [0.0, 0.0, 0.0], shape.radius_m, 0.0
