# SPDX-License-Identifier: Apache-2.0
"""Ray casting as slow and plain as it gets: every ray against every triangle, float64.

Rule: shares nothing with the engine but the triangles and the poses. Moeller and Trumbore 1997, in
the world frame, with matrices interpolated linearly between two poses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from groundlink.world.triangles import Triangles

Floats = NDArray[np.float64]


@dataclass
class Answer:
    range_m: Floats
    normal_in_world: Floats
    label: NDArray[np.int32]
    body: NDArray[np.int32]


def matrices(poses: Floats) -> Floats:
    """Return (..., 4, 4) of positions and quaternions (..., 7), by the textbook."""
    x, y, z, w = np.moveaxis(poses[..., 3:], -1, 0)
    result = np.zeros((*poses.shape[:-1], 4, 4))
    result[..., 0, :3] = np.stack(
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)], -1
    )
    result[..., 1, :3] = np.stack(
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)], -1
    )
    result[..., 2, :3] = np.stack(
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z], -1
    )
    result[..., :3, 3] = poses[..., :3]
    result[..., 3, 3] = 1
    return result


def cast(
    static: Triangles,
    bodies: Sequence[Triangles],
    poses: Floats,
    origins: Floats,
    directions: Floats,
    times: Floats,
    max_range: float = np.inf,
) -> Answer:
    """Return the nearest hits of rays, shape (N, 3) and times (N,); poses as `Scene.move`."""
    count = len(times)
    answer = Answer(
        np.full(count, np.inf),
        np.zeros((count, 3)),
        np.full(count, -1, np.int32),
        np.full(count, -1, np.int32),
    )
    step = times * (len(poses) - 1)
    before = np.clip(np.floor(step).astype(int), 0, len(poses) - 2)
    share = (step - before)[:, None, None]
    for body, mesh in enumerate([static, *bodies], -1):
        if body < 0:
            world_from_body = np.tile(np.eye(4), (count, 1, 1))
        else:
            of_body = matrices(poses[:, body])
            world_from_body = (1 - share) * of_body[before] + share * of_body[before + 1]
        for face, label in zip(mesh.faces, mesh.labels, strict=True):
            corners = mesh.vertices[face].astype(np.float64)
            placed = np.einsum("nij,kj->nki", world_from_body[:, :3, :3], corners)
            a, b, c = np.moveaxis(placed + world_from_body[:, None, :3, 3], 1, 0)
            _meet(answer, a, b - a, c - a, origins, directions, max_range, label, body)
    return answer


def _meet(
    answer: Answer,
    corner: Floats,
    edge1: Floats,
    edge2: Floats,
    origins: Floats,
    directions: Floats,
    max_range: float,
    label: int,
    body: int,
) -> None:
    p = np.cross(directions, edge2)
    determinant = np.sum(edge1 * p, axis=1)
    inverse = 1 / np.where(determinant == 0, np.inf, determinant)
    from_corner = origins - corner
    u = np.sum(from_corner * p, axis=1) * inverse
    q = np.cross(from_corner, edge1)
    v = np.sum(directions * q, axis=1) * inverse
    t = np.sum(edge2 * q, axis=1) * inverse
    hit = (determinant != 0) & (u >= 0) & (v >= 0) & (u + v <= 1)
    hit &= (t > 0) & (t <= max_range) & (t < answer.range_m)
    normal = np.cross(edge1, edge2)
    answer.range_m[hit] = t[hit]
    answer.normal_in_world[hit] = (normal / np.linalg.norm(normal, axis=1, keepdims=True))[hit]
    answer.label[hit] = label
    answer.body[hit] = body
