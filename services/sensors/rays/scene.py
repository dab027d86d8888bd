# SPDX-License-Identifier: Apache-2.0
"""A world with moving bodies in it, and rays that each have an instant of their own.

Rule: what stands still is built once; what moves is given poses at evenly spaced times, between
which matrices are interpolated linearly: a point at radius r on a body that turns by an angle a
from one pose to the next is at most r a^2 / 8 too near the axis (0.2 m, 20 rad/s, 2.5 ms: 0.06 mm).
World frame, metres, float32: a micrometre near the origin. No sensor, noise or material is known
here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from groundlink.frames import Floats, transform
from groundlink.world.triangles import Triangles

from . import embree
from .packets import DIRECTION, IDS, NO_HIT, NORMAL, ORIGIN, RANGE, TIME, Packets

Reals = NDArray[np.float32]
Numbers = NDArray[np.int32]


@dataclass(frozen=True)
class Hits:
    """Where rays ended. The arrays are overwritten by the next cast of as many rays."""

    range_m: Reals
    """Shape (rows, columns): in lengths of the ray's direction, infinite where nothing was hit."""

    normal_in_world: Reals
    """Shape (3, rows, columns): unit vectors out of the surface; without meaning for no hit."""

    label: Numbers
    """Shape (rows, columns): that of the triangle, -1 for no hit."""

    body: Numbers
    """Shape (rows, columns): number of the moving body, -1 for the static world and for no hit."""


class _Workspace:
    """Memory for rows of rays, kept from cast to cast: fresh pages cost more than what is done."""

    def __init__(self, rows: int, columns: int) -> None:
        self.packets = Packets(columns)
        self.range_m = np.empty((1, rows, columns), np.float32)
        self.normal = np.empty((3, rows, columns), np.float32)
        self.ids = np.empty((4, rows, columns), np.int32)
        self.label = np.empty((rows, columns), np.int32)


class Scene:
    """A static world and moving bodies, all of them triangles.

    Parameters
    ----------
    static : Triangles
        In the world frame.
    bodies : sequence of Triangles
        Each in its body's frame. Until the first `move` they are at the world's origin.
    """

    _BODIES = 1
    """Number of the moving bodies in the scene that rays are traced in; the world is 0."""

    def __init__(self, static: Triangles, bodies: Sequence[Triangles] = ()) -> None:
        device = embree.Device()
        meshes = [static, *bodies]
        scenes = [
            embree.Scene(device, [embree.Mesh(device, mesh.vertices, mesh.faces)])
            for mesh in meshes
        ]
        # The static world is an instance too, so that a move does not build it anew.
        self._world = embree.Instance(device, scenes[0])
        self._bodies = embree.InstanceArray(device, scenes[1:])
        self._labels = np.concatenate([mesh.labels for mesh in meshes])
        first = np.cumsum([0, *(len(mesh.labels) for mesh in meshes[:-1])])
        self._first_triangle = first.astype(np.int32)
        self._matrices = embree.aligned((0, len(bodies), 16), np.float32)
        self._workspaces: dict[tuple[int, int], _Workspace] = {}
        self._place(np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (2, len(bodies), 1)))
        self._top = embree.Scene(device, [self._world, self._bodies])

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
        self._bodies.move(self._matrices)

    def cast(self, origins: Reals, directions: Reals, times: Reals, max_range: float) -> Hits:
        """Return the nearest hit of every ray.

        Parameters
        ----------
        origins, directions : float32 arrays, shape (3, rows, columns)
            In the world, metres. Neighbours in a row are traced together: it is fastest where they
            start near each other and in nearly the same direction.
        times : float32 array, shape (rows, columns)
            0..1 between the first and the last pose of the bodies.
        max_range : float
            In lengths of a ray's direction; what is farther is not hit.
        """
        rows, columns = times.shape
        work = self._workspaces.get((rows, columns))
        if work is None:
            work = self._workspaces[rows, columns] = _Workspace(rows, columns)
        packets = work.packets
        for row in range(rows):
            packets.put(ORIGIN, origins[:, row])
            packets.put(DIRECTION, directions[:, row])
            packets.put(TIME, times[None, row])
            packets.trace(self._top, max_range)
            packets.get(RANGE, work.range_m[:, row])
            packets.get(NORMAL, work.normal[:, row])
            packets.get(IDS, work.ids[:, row])
        return self._hits(work, times)

    def _hits(self, work: _Workspace, times: Reals) -> Hits:
        """Give meaning to what Embree wrote."""
        range_m, normal, label = work.range_m[0], work.normal, work.label
        triangle, geometry, instance, body = work.ids
        missed = geometry == NO_HIT
        body[missed | (instance != self._BODIES)] = -1
        triangle[missed] = 0
        normal[:, missed] = 1
        range_m[missed] = np.inf
        triangle += self._first_triangle[body + 1]
        np.take(self._labels, triangle, out=label)
        label[missed] = -1
        # Embree's normals are in the body's frame and as long as the triangle is large.
        moving, flat = np.flatnonzero(body >= 0), normal.reshape(3, -1)
        flat[:, moving] = self._rotated(
            flat[:, moving], body.ravel()[moving], times.ravel()[moving]
        )
        normal *= 1 / np.sqrt(np.einsum("irc,irc->rc", normal, normal))
        return Hits(range_m=range_m, normal_in_world=normal, label=label, body=body)

    def _rotated(self, vectors_in_body: Reals, body: Numbers, times: Reals) -> Reals:
        """Return vectors, shape (3, N), in the world, as each body stands at each time."""
        step = times * (len(self._matrices) - 1)
        before = np.minimum(step.astype(np.intp), len(self._matrices) - 2)
        rotations = self._matrices.reshape(*self._matrices.shape[:2], 4, 4)[..., :3, :3]
        first, second = rotations[before, body], rotations[before + 1, body]
        body_from_world = first + (step - before)[:, None, None] * (second - first)
        rotated: Reals = np.einsum("in,nij->jn", vectors_in_body, body_from_world)
        return rotated
