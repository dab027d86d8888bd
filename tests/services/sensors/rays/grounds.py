# SPDX-License-Identifier: Apache-2.0
"""Terrain for tests: as rays meet it, and as triangles for the oracle."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from groundlink.world.terrain import Ground
from groundlink.world.triangles import Triangles


def ground(
    heights: ArrayLike,
    cell_m: float = 1.0,
    at_m: tuple[float, float] = (0.0, 0.0),
    surface: NDArray[np.uint8] | None = None,
) -> Ground:
    """Return terrain whose vertex [0, 0] is at `at_m`."""
    heights = np.ascontiguousarray(heights, np.float32)
    if surface is None:
        surface = np.zeros((heights.shape[0] - 1, heights.shape[1] - 1), np.uint8)
    names = tuple(f"soil{i}" for i in range(int(surface.max(initial=0)) + 1))
    return Ground(heights, surface, cell_m, *at_m, names)


def triangles(ground: Ground, first_label: int = 0) -> Triangles:
    """Return terrain as triangles: each cell is cut from its south-east to its north-west corner.

    They are exactly those of the terrain where the map's numbers are sums of few powers of two.
    """
    rows, columns = ground.heights.shape
    x = ground.x0_m + ground.cell_m * np.arange(columns)
    y = ground.y0_m + ground.cell_m * np.arange(rows)
    east, north = np.meshgrid(x, y)
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (
        n.ravel() for n in (number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:])
    )
    faces = np.stack([np.stack([a, b, c], -1), np.stack([d, c, b], -1)], axis=1)
    return Triangles(
        np.stack([east, north, ground.heights], -1).reshape(-1, 3).astype(np.float32),
        faces.reshape(-1, 3).astype(np.uint32),
        first_label + np.repeat(ground.surface.ravel(), 2).astype(np.int32),
    )


def rough(rng: np.random.Generator, rows: int, columns: int, rough_m: float) -> NDArray[np.float32]:
    """Return random heights, no two alike."""
    return rng.normal(0, rough_m, (rows, columns)).astype(np.float32)
