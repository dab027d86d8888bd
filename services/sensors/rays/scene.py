# SPDX-License-Identifier: Apache-2.0
"""Scene: a static world with moving bodies, and rays that each have an instant of their own.

Moving bodies have poses at evenly spaced times; for every ray, positions are interpolated linearly
and orientations by nlerp. Ranges are exact within float32: origins of rays are rounded by up to
4 micrometers at 100 m from the world's origin, 0.25 mm at 7 km.
"""

import ctypes
import sys
from collections.abc import Sequence
from ctypes import c_int, c_void_p
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from groundlink.core.frames import Floats
from groundlink.world.triangles import Triangles

from .builtin import BoxTree, BuiltinEngine
from .embree import EmbreeEngine, EngineUnavailableError, device
from .engine import RayEngine, SceneMeshes
from .kernels import kernels
from .terrain import Relief

MARGIN = 1e-6
"""Relative margin of boxes around bodies, more than the rounding of rays."""

Reals = NDArray[np.float32]
Numbers = NDArray[np.int32]


@dataclass(frozen=True)
class Hits:
    """Hits of rays. The arrays are overwritten by the next cast of rays in this shape."""

    range_m: Reals
    """Shape (...): in lengths of the ray's direction, infinite where nothing was hit."""

    normal_in_world: Reals
    """Shape (3, ...): unit vectors out of the surface, zero where nothing was hit."""

    label: Numbers
    """Shape (...): label of the triangle, -1 for no hit."""

    body: Numbers
    """Shape (...): number of the moving body, -1 for the static world and for no hit."""


class _RayWorld(ctypes.Structure):
    """The structure `ray_world` of `tracer.c`."""

    _fields_ = (
        *((name, c_void_p) for name in ("intersect", "scenes")),
        *((name, c_void_p) for name in ("vertices", "faces", "first_triangle", "first_label")),
        *((name, c_void_p) for name in ("poses", "boxes", "nodes", "order", "terrain", "still")),
        *((name, c_int) for name in ("steps", "bodies")),
    )


@cache
def best_engine() -> type[RayEngine]:
    """Return Embree if it works, else the built-in engine with a line on stderr, once."""
    try:
        device()
    except EngineUnavailableError as reason:
        print(f"rays: using the slower built-in engine: {reason}", file=sys.stderr)
        return BuiltinEngine
    return EmbreeEngine


class Scene:
    """A static world, its terrain, and moving bodies, all of them triangles.

    Parameters
    ----------
    static : Triangles
        In the world frame.
    bodies : sequence of Triangles
        Each in its body's frame. Until the first `move` they are at the world's origin.
    engine
        Default: `best_engine()`.
    terrain : Relief or None
        Hit as heights, by any engine.
    """

    def __init__(
        self,
        static: Triangles,
        bodies: Sequence[Triangles] = (),
        engine: type[RayEngine] | None = None,
        terrain: Relief | None = None,
    ) -> None:
        self._terrain = terrain
        self._meshes = SceneMeshes.joined(static, bodies)
        self._engine = (engine or best_engine())(self._meshes)
        used = self._meshes.mesh
        self._scenes = (c_void_p * len(used))(*(self._engine.scenes[mesh] for mesh in used))
        self._first_triangle: Numbers = np.array(self._meshes.ends, np.int32)[used]
        self._radii: Floats = np.array(
            [np.linalg.norm(mesh.vertices, axis=1).max(initial=0) for mesh in bodies], np.float64
        ) * (1 + MARGIN)
        self._boxes: Reals = np.zeros((len(bodies), 2, 3), np.float32)
        for box, mesh in zip(self._boxes, bodies, strict=True):
            if len(mesh.vertices):
                box[:] = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        corners = static.vertices, np.empty((0, 3)) if terrain is None else terrain.corners
        self._still: Reals = np.stack([_box_around(points) for points in corners])
        self._hits: dict[tuple[int, ...], Hits] = {}
        self.move(np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (2, len(bodies), 1)))

    def move(self, world_from_body: Floats) -> None:
        """Set the bodies' motion during the next casts.

        Parameters
        ----------
        world_from_body : float64 array, shape (steps, bodies, 7)
            Position xyz in meters and unit quaternion xyzw at evenly spaced instants, of which the
            first is time 0 of a ray and the last is time 1; at least two.
        """
        self._poses = np.ascontiguousarray(world_from_body, np.float64)
        steps, bodies, _ = self._poses.shape
        ways = np.empty((bodies, 2, 3), np.float32)
        known = self._radii, self._boxes
        kernels().groundlink_ways(
            *(self._poses.ctypes.data, steps, bodies),
            *(array.ctypes.data for array in (*known, ways)),
        )
        self._tree = BoxTree(ways, leaf_items=1)

    def cast(self, origins: Reals, directions: Reals, times: Reals, max_range: float) -> Hits:
        """Return the nearest hit of every ray.

        Parameters
        ----------
        origins, directions : float32 arrays, shape (3, ...)
            In the world, meters. Neighbors along the last axis are traced together: it is fastest
            where they start near each other and in nearly the same direction.
        times : float32 array, shape (...)
            0..1 between the first and the last pose of the bodies.
        max_range : float
            In lengths of a ray's direction; surfaces beyond are not hit.
        """
        shape = times.shape
        if shape not in self._hits:
            # Reused from cast to cast: allocating costs more than writing.
            reals, numbers = np.empty((4, *shape), np.float32), np.empty((2, *shape), np.int32)
            self._hits[shape] = Hits(reals[0], reals[1:], numbers[0], numbers[1])
        hits = self._hits[shape]
        meshes, tree = self._meshes, self._tree
        known = meshes.vertices, meshes.faces, self._first_triangle, meshes.first_label
        moved = self._poses, self._boxes, tree.nodes, tree.order
        around = _RayWorld(
            self._engine.intersect,
            ctypes.addressof(self._scenes),
            *(array.ctypes.data for array in (*known, *moved)),
            None if self._terrain is None else ctypes.addressof(self._terrain.structure),
            *(self._still.ctypes.data, *self._poses.shape[:2]),
        )
        rays = [np.ascontiguousarray(array, np.float32) for array in (origins, directions, times)]
        ends = hits.range_m, hits.normal_in_world, hits.label, hits.body
        addresses = [array.ctypes.data for array in (*rays, *ends)]

        kernels().groundlink_trace(ctypes.byref(around), times.size, max_range, *addresses)
        return hits


def _box_around(points: NDArray[np.floating]) -> Reals:
    """Return the lowest and the highest corner of a box around points, shape (N, 3).

    It is wider than the points by more than the rounding of rays, and inside out without points.
    """
    margin = 1e-3 + 1e-5 * np.abs(points).max(initial=0)
    low, high = points.min(axis=0, initial=np.inf), points.max(axis=0, initial=-np.inf)
    return np.array([low - margin, high + margin], np.float32)
