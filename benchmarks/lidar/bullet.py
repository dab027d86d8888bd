# SPDX-License-Identifier: Apache-2.0
"""PyBullet's rayTestBatch, with one thread, on rays and worlds that were made for it beforehand."""

from pathlib import Path

import numpy as np
import pybullet

from groundlink.core.frames import Floats, matrix_from_quaternion, multiply
from groundlink.world.solids import Box, Cylinder, Solid, Sphere
from groundlink.world.triangles import Triangles
from services.sensors.rays.scene import Reals

RAYS_A_CALL = 16384
"""PyBullet's MAX_RAY_INTERSECTION_BATCH_SIZE."""

ORIGIN = np.array([[0, 0, 0, 0, 0, 0, 1.0]])
"""The pose of a body in the world's own frame."""


class Bullet:
    """A world at rest, after a first step as in any running simulation: it is faster before."""

    def __init__(self) -> None:
        self._client = pybullet.connect(pybullet.DIRECT)
        self._calls: list[tuple[list[list[float]], list[list[float]]]] = []

    @property
    def bodies(self) -> int:
        """Of the world."""
        return int(pybullet.getNumBodies(self._client))

    def _put(self, shape: int, position: Floats, orientation: Floats) -> None:
        pybullet.createMultiBody(
            baseCollisionShapeIndex=shape,
            basePosition=position.tolist(),
            baseOrientation=orientation.tolist(),
            physicsClientId=self._client,
        )

    def add(self, solid: Solid, world_from_frame: Floats) -> None:
        """Add a solid of a frame."""
        client = {"physicsClientId": self._client}
        match solid.shape:
            case Box(size_m=size):
                half = [length / 2 for length in size]
                shape = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=half, **client)
            case Cylinder(radius_m=radius, length_m=length):
                shape = pybullet.createCollisionShape(
                    pybullet.GEOM_CYLINDER, radius=radius, height=length, **client
                )
            case Sphere(radius_m=radius):
                shape = pybullet.createCollisionShape(pybullet.GEOM_SPHERE, radius=radius, **client)
        place, turn = world_from_frame[:3], world_from_frame[3:]
        self._put(
            shape,
            place + matrix_from_quaternion(turn) @ solid.position_m,
            multiply(turn, solid.orientation),
        )

    def add_heights(self, heights: Reals, cell_m: float) -> None:
        """Add a field of heights around the origin, shape (points, points), y before x."""
        points = len(heights)
        shape = pybullet.createCollisionShape(
            pybullet.GEOM_HEIGHTFIELD,
            meshScale=[cell_m, cell_m, 1.0],
            heightfieldData=heights.reshape(-1).tolist(),
            numHeightfieldRows=points,
            numHeightfieldColumns=points,
            physicsClientId=self._client,
        )
        middle = np.array([0.0, 0.0, (float(heights.min()) + float(heights.max())) / 2])
        self._put(shape, middle, ORIGIN[0, 3:])

    def add_mesh(self, mesh: Triangles, folder: Path, world_from_body: Floats = ORIGIN) -> None:
        """Add triangles at poses, shape (bodies, 7), by a file, as PyBullet takes concave ones.

        A convex body is faster in this form, too: a tree of its triangles is searched, while the
        hull of its corners is searched as a whole.
        """
        path = folder / "mesh.obj"
        with path.open("w", encoding="ascii") as file:
            file.writelines(f"v {x:.7g} {y:.7g} {z:.7g}\n" for x, y, z in mesh.vertices.tolist())
            file.writelines(f"f {a} {b} {c}\n" for a, b, c in (mesh.faces + 1).tolist())
        # PyBullet keeps files by name, also changed ones.
        path = path.rename(folder / f"mesh_{self._client}_{self.bodies}.obj")
        shape = pybullet.createCollisionShape(
            pybullet.GEOM_MESH,
            fileName=str(path),
            flags=pybullet.GEOM_FORCE_CONCAVE_TRIMESH,
            physicsClientId=self._client,
        )
        for pose in world_from_body:
            self._put(shape, pose[:3], pose[3:])

    def aim(self, origins: Reals, directions: Reals, max_range_m: float) -> None:
        """Make ready to cast rays, each array of shape (3, ...), in the world as it is now."""
        pybullet.stepSimulation(self._client)
        start = origins.reshape(3, -1).T.astype(np.float64)
        end = start + max_range_m * directions.reshape(3, -1).T
        self._calls = [
            (start[first : first + RAYS_A_CALL].tolist(), end[first : first + RAYS_A_CALL].tolist())
            for first in range(0, len(start), RAYS_A_CALL)
        ]

    def cast(self) -> Floats:
        """Cast all rays; return how much of its way each went, 1 where nothing was hit."""
        hits = [
            pybullet.rayTestBatch(start, end, numThreads=1, physicsClientId=self._client)
            for start, end in self._calls
        ]
        return np.array([hit[2] for call in hits for hit in call])
