# SPDX-License-Identifier: Apache-2.0
"""Ray casting as slow and plain as it gets: every ray against every triangle, float64.

Rule: shares nothing with the engines but the triangles and the poses. Bodies are rigid: between two
poses position is interpolated linearly and orientation by nlerp, for every ray anew. Moeller and
Trumbore 1997, in the body's frame. Only rays that pass the ball around a body are tried on it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from groundlink.world.triangles import Triangles

Floats = NDArray[np.float64]

TRIED_AT_ONCE = 10_000
"""Pairs of ray and triangle. Their arrays stay in the cache and below 256 KiB: AddressSanitizer
maps each larger one anew, which doubles the time of its tests."""


@dataclass
class Answer:
    range_m: Floats
    normal_in_world: Floats
    label: NDArray[np.int32]
    body: NDArray[np.int32]


def rotations(quaternions: Floats) -> Floats:
    """Return (..., 3, 3) of unit quaternions (..., 4), by the textbook."""
    x, y, z, w = np.moveaxis(quaternions, -1, 0)
    rows = [
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
    return np.stack([np.stack(row, -1) for row in rows], -2)


def between(poses: Floats, times: Floats) -> tuple[Floats, Floats]:
    """Return positions (N, 3) and rotations (N, 3, 3) at times 0..1 of evenly spaced poses."""
    step = times * (len(poses) - 1)
    before = np.clip(np.floor(step).astype(int), 0, len(poses) - 2)
    share = (step - before)[:, None]
    first, second = poses[before], poses[before + 1]
    same_side = np.sum(first[:, 3:] * second[:, 3:], axis=1, keepdims=True) >= 0
    turn = (1 - share) * first[:, 3:] + share * np.where(same_side, 1, -1) * second[:, 3:]
    turn /= np.linalg.norm(turn, axis=1, keepdims=True)
    return (1 - share) * first[:, :3] + share * second[:, :3], rotations(turn)


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
    origins, directions, times = (np.asarray(a, np.float64) for a in (origins, directions, times))
    count = len(times)
    answer = Answer(
        np.full(count, max_range, np.float64),
        np.zeros((count, 3)),
        np.full(count, -1, np.int32),
        np.full(count, -1, np.int32),
    )
    _try(answer, static, -1, np.arange(count), origins, directions, None)
    for body, mesh in enumerate(bodies):
        if not len(mesh.faces):
            continue
        position, turn = between(poses[:, body], times)
        middle = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)).astype(np.float64) / 2
        radius = np.linalg.norm(mesh.vertices - middle, axis=1).max() + 1e-6
        to_middle = position + turn @ middle - origins
        aside = np.linalg.norm(np.cross(to_middle, directions), axis=1)
        near = np.flatnonzero(aside <= radius * np.linalg.norm(directions, axis=1))
        back = np.swapaxes(turn[near], 1, 2)
        local = (np.einsum("nij,nj->ni", back, v[near]) for v in (origins - position, directions))
        _try(answer, mesh, body, near, *local, turn[near])
    answer.range_m[answer.label < 0] = np.inf
    return answer


def _try(
    answer: Answer,
    mesh: Triangles,
    body: int,
    rays: NDArray[np.intp],
    origins: Floats,
    directions: Floats,
    turn: Floats | None,
) -> None:
    """Try some rays, given in the frame of a mesh, on all of its triangles."""
    if not len(mesh.faces):
        return
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    edges = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normals = np.cross(*edges)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    a, edge1, edge2 = (np.ascontiguousarray(v.T) for v in (corners[:, 0], *edges))
    at_once = max(1, TRIED_AT_ONCE // len(corners))
    for begin in range(0, len(rays), at_once):
        some = slice(begin, begin + at_once)
        ray = rays[some]
        direction = directions[some].T[..., None]
        p = _cross(direction, edge2)
        determinant = _dot(edge1, p)
        inverse = 1 / np.where(determinant == 0, np.inf, determinant)
        from_corner = origins[some].T[..., None] - a[:, None]
        u = _dot(from_corner, p) * inverse
        q = _cross(from_corner, edge1)
        v = _dot(direction, q) * inverse
        t = _dot(edge2, q) * inverse
        met = (determinant != 0) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
        t = np.where(met & (t <= answer.range_m[ray][:, None]), t, np.inf)
        nearest = np.argmin(t, axis=1)
        hit = np.isfinite(t[np.arange(len(ray)), nearest])
        face, ray = nearest[hit], ray[hit]
        answer.range_m[ray] = t[hit, face]
        normal = normals[face]
        if turn is not None:
            normal = np.einsum("nij,nj->ni", turn[some][hit], normal)
        answer.normal_in_world[ray] = normal
        answer.label[ray], answer.body[ray] = mesh.labels[face], body


def _cross(a: Sequence[Floats] | Floats, b: Sequence[Floats] | Floats) -> list[Floats]:
    """Return the three components of a cross product; NumPy's own takes several times as long."""
    return [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]


def _dot(a: Sequence[Floats] | Floats, b: Sequence[Floats] | Floats) -> Floats:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
