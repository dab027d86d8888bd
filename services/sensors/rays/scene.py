# SPDX-License-Identifier: Apache-2.0
"""A world with moving bodies in it, and rays that each have an instant of their own.

Rule: what stands still is built once; what moves is given poses at evenly spaced times, between
which matrices are interpolated linearly: a point at radius r on a body that turns by an angle a
from one pose to the next is at most r a^2 / 8 too near the axis (0.2 m, 20 rad/s, 2.5 ms: 0.06 mm).
World frame, metres, float32: a micrometre near the origin. No sensor, noise or material is known
here.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from ctypes import c_int, c_void_p
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from groundlink.frames import Floats, transform
from groundlink.world.triangles import Triangles

from . import embree
from .kernels import kernels

PACKET = 8
"""Rays that `tracer.c` traces at once."""

_HELPER = ThreadPoolExecutor(1, "rays")
"""Traces half of the rays. A ray's bits do not depend on who traces it."""

Reals = NDArray[np.float32]
Numbers = NDArray[np.int32]


@dataclass(frozen=True)
class Hits:
    """Where rays ended. The arrays are overwritten by the next cast of rays in this shape."""

    range_m: Reals
    """Shape (...): in lengths of the ray's direction, infinite where nothing was hit."""

    normal_in_world: Reals
    """Shape (3, ...): unit vectors out of the surface, zero where nothing was hit."""

    label: Numbers
    """Shape (...): that of the triangle, -1 for no hit."""

    body: Numbers
    """Shape (...): number of the moving body, -1 for the static world and for no hit."""


class _Surroundings(ctypes.Structure):
    """The structure of `tracer.c`."""

    _fields_ = (
        ("scene", c_void_p),
        ("labels", c_void_p),
        ("first_triangle", c_void_p),
        ("matrices", c_void_p),
        ("steps", c_int),
        ("bodies", c_int),
    )


class Scene:
    """A static world and moving bodies, all of them triangles.

    Parameters
    ----------
    static : Triangles
        In the world frame.
    bodies : sequence of Triangles
        Each in its body's frame. Until the first `move` they are at the world's origin.
    """

    def __init__(self, static: Triangles, bodies: Sequence[Triangles] = ()) -> None:
        device = embree.Device()
        meshes = [static, *bodies]
        scenes = [
            embree.Scene(device, [embree.Mesh(device, mesh.vertices, mesh.faces)])
            for mesh in meshes
        ]
        self._bodies = embree.InstanceArray(device, scenes[1:]) if bodies else None
        self._labels = np.concatenate([mesh.labels for mesh in meshes])
        counts = np.array([len(mesh.labels) for mesh in meshes], np.int32)
        self._first_triangle = (np.cumsum(counts) - counts).astype(np.int32)
        self._matrices = embree.aligned((0, len(bodies), 16), np.float32)
        self._hits: dict[tuple[int, ...], Hits] = {}
        self._place(np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (2, len(bodies), 1)))
        # The static world is an instance too, the first, so that a move does not build it anew.
        world = embree.Instance(device, scenes[0])
        self._top = embree.Scene(device, [world, self._bodies] if self._bodies else [world])

    def move(self, world_from_body: Floats) -> None:
        """Set the bodies' motion during the next casts.

        Parameters
        ----------
        world_from_body : float64 array, shape (steps, bodies, 7)
            Position xyz in metres and unit quaternion xyzw at evenly spaced instants, of which the
            first is time 0 of a ray and the last is time 1; at least two.
        """
        self._place(world_from_body)
        self._top.commit()

    def _place(self, world_from_body: Floats) -> None:
        matrices = transform(world_from_body[..., :3], world_from_body[..., 3:])
        if len(matrices) != len(self._matrices):
            self._matrices = embree.aligned((*matrices.shape[:2], 16), np.float32)
        self._matrices[:] = np.swapaxes(matrices, -1, -2).reshape(self._matrices.shape)
        if self._bodies:
            self._bodies.move(self._matrices)

    def cast(self, origins: Reals, directions: Reals, times: Reals, max_range: float) -> Hits:
        """Return the nearest hit of every ray.

        Parameters
        ----------
        origins, directions : float32 arrays, shape (3, ...)
            In the world, metres. Neighbours along the last axis are traced together: it is fastest
            where they start near each other and in nearly the same direction.
        times : float32 array, shape (...)
            0..1 between the first and the last pose of the bodies.
        max_range : float
            In lengths of a ray's direction; what is farther is not hit.
        """
        shape = times.shape
        if shape not in self._hits:
            # Kept from cast to cast: fresh pages cost more than what is written on them.
            reals, numbers = np.empty((4, *shape), np.float32), np.empty((2, *shape), np.int32)
            self._hits[shape] = Hits(reals[0], reals[1:], numbers[0], numbers[1])
        hits = self._hits[shape]
        around = _Surroundings(
            self._top.handle,
            self._labels.ctypes.data,
            self._first_triangle.ctypes.data,
            self._matrices.ctypes.data,
            *self._matrices.shape[:2],
        )
        rays = [np.ascontiguousarray(array, np.float32) for array in (origins, directions, times)]
        ends = hits.range_m, hits.normal_in_world, hits.label, hits.body
        addresses = [array.ctypes.data for array in (*rays, *ends)]

        def trace(begin: int, end: int) -> None:
            kernels().groundlink_trace(
                *(embree.intersect_function(), ctypes.byref(around)),
                *(times.size, begin, end, max_range, *addresses),
            )

        half = times.size // 2 // PACKET * PACKET
        other = _HELPER.submit(trace, half, times.size)
        trace(0, half)
        other.result()
        return hits
