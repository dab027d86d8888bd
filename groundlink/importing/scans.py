# SPDX-License-Identifier: Apache-2.0
"""Scans without faces: each point becomes a small disc in the surface around it.

Unseen areas stay open. A scan with too many points is thinned to one point a cube. The normal of a
disc is the least principal axis of the points around it (Hoppe et al. 1992); its sign is arbitrary,
since rays meet both sides.
"""

import itertools

import numpy as np
from numpy.typing import NDArray

from groundlink.core.frames import Floats

CORNERS = 6
"""Corners of a disc; a hexagon covers 83 % of its circle."""

WIDER = 1.0
"""Radius of a disc in point distances: covers all of a regular grid, and five sixths of randomly
placed points."""


def thinned(
    points: Floats, colors: NDArray[np.float64], most: int
) -> tuple[Floats, NDArray[np.float64], float]:
    """Return at most `most` points with their colors, and their distance.

    Each cube keeps the mean of its points.

    Parameters
    ----------
    points : float64 array, shape (N, 3)
    colors : float64 array, shape (N, 3)
    """
    size = np.ptp(points, axis=0)
    # First guess: points evenly spread over a rectangle of the two longest sides.
    edge = max(float(np.sqrt(np.prod(np.sort(size)[1:]) / len(points))), 1e-6 * size.max(), 1e-9)
    while True:
        keys = _keys(points, edge)
        kept, place, count = np.unique(keys, return_inverse=True, return_counts=True)
        if len(kept) <= most:
            break
        edge *= max(1.1, float(np.sqrt(len(kept) / most)))

    def means(values: NDArray[np.float64]) -> NDArray[np.float64]:
        sums = [np.bincount(place, column, len(kept)) for column in values.T]
        return np.stack(sums, axis=-1) / count[:, None]

    return means(points), means(colors), edge


def normals(points: Floats, apart_m: float) -> Floats:
    """Return unit normals, shape (N, 3), of the surface that points, shape (N, 3), lie on."""
    edge = 2 * apart_m
    # One row each of count, sums and products of coordinates of all points in a cube, then of the
    # 27 cubes around: enough for the covariance.
    local = points - points.mean(axis=0)
    products = local[:, (0, 0, 0, 1, 1, 2)] * local[:, (0, 1, 2, 1, 2, 2)]
    rows = np.concatenate([np.ones((len(points), 1)), local, products], axis=1)
    cubes = np.floor((points - points.min(axis=0)) / edge).astype(np.int64) + 1
    widths = cubes.max(axis=0) + 2
    keys = (cubes[:, 0] * widths[1] + cubes[:, 1]) * widths[2] + cubes[:, 2]
    known, place = np.unique(keys, return_inverse=True)
    sums = np.stack([np.bincount(place, column, len(known)) for column in rows.T], axis=-1)
    around = np.zeros_like(sums)
    for x, y, z in itertools.product((-1, 0, 1), repeat=3):
        wanted = known + (x * widths[1] + y) * widths[2] + z
        at = np.minimum(np.searchsorted(known, wanted), len(known) - 1)
        around += np.where((known[at] == wanted)[:, None], sums[at], 0.0)
    mean = around[:, 1:4] / around[:, :1]
    xx, xy, xz, yy, yz, zz = (around[:, 4:] / around[:, :1]).T
    second = np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=-1).reshape(-1, 3, 3)
    _, axes = np.linalg.eigh(second - mean[:, :, None] * mean[:, None, :])
    return axes[place, :, 0]


def discs(points: Floats, normal: Floats, radius_m: float) -> tuple[Floats, NDArray[np.int64]]:
    """Return vertices, shape (N CORNERS, 3), and faces of a disc around every point."""
    least = np.eye(3)[np.abs(normal).argmin(axis=1)]
    first = np.cross(normal, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normal, first)
    turn = np.arange(CORNERS) * (2 * np.pi / CORNERS)
    around = np.cos(turn)[:, None] * first[:, None] + np.sin(turn)[:, None] * second[:, None]
    vertices = points[:, None] + radius_m * around
    fan = np.array([(0, k, k + 1) for k in range(1, CORNERS - 1)])
    faces = fan + CORNERS * np.arange(len(points))[:, None, None]
    return vertices.reshape(-1, 3), faces.reshape(-1, 3)


def _keys(points: Floats, edge: float) -> NDArray[np.int64]:
    """Return one number for the cube of each point."""
    cubes = np.floor((points - points.min(axis=0)) / edge).astype(np.int64)
    widths = cubes.max(axis=0) + 1
    keys: NDArray[np.int64] = (cubes[:, 0] * widths[1] + cubes[:, 1]) * widths[2] + cubes[:, 2]
    return keys
