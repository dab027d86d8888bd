# SPDX-License-Identifier: Apache-2.0
"""Ruts near the eye as a mesh: refined cells of the terrain in place of the map's own.

Around a cell with ruts the ground is as the map has it, so that both fit together. Which cells are
refined follows from the ruts and from the cell below the eye alone.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from groundlink.core.frames import Floats
from groundlink.world.ruts import SIDE, STEP_M, RutGrid
from groundlink.world.terrain import Ground

REACH_M = 20.0
"""Largest distance of refined cells from the eye's, along x and y. Others have no ruts in pictures.
"""

MOST_TRIANGLES = 400_000
"""Of a picture's ruts; farther cells are left as they are."""

LEAST_SUN = 0.1
"""Cosine of the sun's angle to the map's surface: at flatter light, shading grows no more."""

VERTEX = np.dtype([("at", "<f4", 3), ("normal", "<f4", 3), ("sunward", "<f4")])


class PressedGround(NamedTuple):
    """The refined cells around an eye."""

    rows: NDArray[np.intp]
    """Of the map's cells, nearest first; so are `columns`."""

    columns: NDArray[np.intp]
    origin_m: Floats
    """Where `vertices` are relative to, shape (3,)."""

    vertices: NDArray[np.void]
    """`VERTEX` records, shape (cells, (parts + 1) ** 2), row by row."""


def pressed_ground(
    ground: Ground, ruts: RutGrid, eye_cell: tuple[int, int], sun: Floats | None
) -> PressedGround:
    """Return the refined cells around an eye.

    Parameters
    ----------
    eye_cell
        row and column of the cell below the eye, also beside the map.
    sun
        direction to the sun; None: lamps light the ground.
    """
    parts = ruts.parts
    reach = int(np.ceil(REACH_M / ground.cell_m))
    (south, north), (west, east) = (
        (max(at - reach, 0), min(at + reach + 1, n - 1))
        for at, n in zip(eye_cell, ground.heights.shape, strict=True)
    )
    count = max(north - south, 0), max(east - west, 0)
    depths = _depths(ruts, parts * south, parts * west, [parts * n + 1 for n in count])
    pressed = _by_cell(depths, parts).any(axis=(2, 3))
    rows, columns = np.nonzero(pressed)
    away = (rows + south - eye_cell[0]) ** 2 + (columns + west - eye_cell[1]) ** 2
    nearest = np.argsort(away, kind="stable")[: MOST_TRIANGLES // (2 * parts**2)]
    rows, columns = rows[nearest], columns[nearest]
    below = _by_cell(depths, parts)[rows, columns].astype(np.float64)
    slopes = [
        _by_cell(np.gradient(depths, ruts.cell_m, axis=axis), parts)[rows, columns]
        if min(depths.shape) > 1
        else below
        for axis in (1, 0)
    ]
    rows, columns = rows + south, columns + west
    corners = [ground.heights[rows + j, columns + i] for j, i in np.ndindex(2, 2)]
    a, b, c, d = (corner.astype(np.float64)[:, None, None] for corner in corners)
    v, u = np.indices((parts + 1, parts + 1)) / parts
    is_south_west = u + v <= 1
    heights = np.where(
        is_south_west, a + u * (b - a) + v * (c - a), d + (1 - u) * (c - d) + (1 - v) * (b - d)
    )
    uphill = [
        np.where(is_south_west, first, second) / ground.cell_m
        for first, second in ((b - a, d - c), (c - a, d - b))
    ]
    level = _normals(*uphill)
    normal = _normals(*(of_map - of_rut for of_map, of_rut in zip(uphill, slopes, strict=True)))
    anchor = np.array(eye_cell[::-1]) * ground.cell_m
    origin = np.array([ground.x0_m, ground.y0_m, 0.0])
    origin[:2] += anchor
    origin[2] = float(a.mean()) if a.size else 0.0
    vertices = np.zeros(heights.shape, VERTEX)
    vertices["at"][..., 0] = (columns[:, None, None] + u) * ground.cell_m - anchor[0]
    vertices["at"][..., 1] = (rows[:, None, None] + v) * ground.cell_m - anchor[1]
    vertices["at"][..., 2] = heights - below - origin[2]
    vertices["normal"] = normal
    if sun is not None:
        before = np.maximum(level @ sun, LEAST_SUN)
        vertices["sunward"] = np.maximum(normal @ sun, 0.0) / before
    return PressedGround(rows, columns, origin, vertices.reshape(len(rows), (parts + 1) ** 2))


def faces(cells: int, parts: int) -> NDArray[np.uint32]:
    """Return the triangles of refined cells, shape (faces, 3), split as cells of the terrain."""
    side = parts + 1
    number = np.arange(side * side).reshape(side, side)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
    each = np.stack([np.stack(corners, axis=-1) for corners in ((a, b, c), (d, c, b))])
    whole = each.reshape(-1, 3) + side**2 * np.arange(cells)[:, None, None]
    return whole.reshape(-1, 3).astype(np.uint32)


def _depths(ruts: RutGrid, south: int, west: int, shape: list[int]) -> Floats:
    """Return depths, m, at the vertices of a part of the grid."""
    found = np.zeros(shape)
    first = np.array([south, west])
    tiles = np.stack(np.divmod(ruts.keys[: ruts.count], ruts.tile_columns), axis=-1)
    at = SIDE * tiles - first
    inside = ((at > -SIDE) & (at < shape)).all(axis=1)
    for number in np.nonzero(inside)[0]:
        j, i = at[number]
        here = found[max(j, 0) : j + SIDE, max(i, 0) : i + SIDE]
        tile = ruts.depths[number, max(-j, 0) :, max(-i, 0) :]
        here[:] = tile[: here.shape[0], : here.shape[1]] * STEP_M
    return found


def _by_cell(of_vertices: Floats, parts: int) -> Floats:
    """Return the values at the vertices of each cell, shape (rows, columns, parts + 1, parts + 1).

    It is a view; neighbors share the vertices of their edge.
    """
    rows, columns = ((n - 1) // parts for n in of_vertices.shape)
    along, across = of_vertices.strides
    return np.lib.stride_tricks.as_strided(
        of_vertices,
        (rows, columns, parts + 1, parts + 1),
        (parts * along, parts * across, along, across),
        writeable=False,
    )


def _normals(east: Floats, north: Floats) -> Floats:
    """Return the unit normals of surfaces with these slopes."""
    normal = np.stack(np.broadcast_arrays(-east, -north, 1.0), axis=-1)
    unit: Floats = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    return unit
