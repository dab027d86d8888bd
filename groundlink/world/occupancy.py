# SPDX-License-Identifier: Apache-2.0
"""Occupancy maps: which cells of a grid are occupied by a world's solids, and which are free.

A cell is occupied where a solid overlaps it within a band of heights, free where only ground lies
below the band at its center, and unknown elsewhere. Heights count from the terrain, or from z = 0.
Rows run along +y of the map, columns along +x, as in nav_msgs/OccupancyGrid.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import ceil, cos, floor, sin

import numpy as np
from numpy.typing import NDArray

from groundlink.core.errors import UserError
from groundlink.core.frames import Floats

from . import triangles
from .bounds import bounds
from .solids import Mesh, Solid
from .terrain import Ground

FREE, OCCUPIED, UNKNOWN = 0, 100, -1
"""Values of cells."""

MAX_CELLS = 16_000_000
"""As many cells as one message to ROS holds: 255 datagrams of 65,280 bytes."""

TOUCH_M = 1e-3
"""Overlap that does not count: a wall that ends where a cell begins leaves the cell free."""

_CLOSED = 1e-6
"""In cells. A surface without thickness between two cells occupies both."""

Cells = NDArray[np.int8]
Mask = NDArray[np.bool_]

Heights = tuple[float, float]
"""Lowest and highest height above the ground, meters; both may be equal."""


@dataclass(frozen=True)
class MapGrid:
    """Position and size of a map's cells in the world."""

    resolution_m: float
    """Edge length of a cell."""

    x_m: float
    """Position of the outer corner of cell [0, 0]."""

    y_m: float
    yaw_rad: float
    """Rotation of the map's axes from the world's, counterclockwise."""

    rows: int
    columns: int

    def in_cells(self, points_m: Floats) -> Floats:
        """Return points of the world, shape (N, 2), as columns and rows of the map, in cells."""
        c, s = cos(self.yaw_rad), sin(self.yaw_rad)
        local: Floats = (points_m - (self.x_m, self.y_m)) @ np.array([[c, -s], [s, c]])
        return local / self.resolution_m

    def centers_m(self) -> Floats:
        """Return the centers of all cells in the world, shape (rows, columns, 2)."""
        x, y = (self.resolution_m * (np.arange(n) + 0.5) for n in (self.columns, self.rows))
        local = np.stack(np.meshgrid(x, y), axis=-1)
        c, s = cos(self.yaw_rad), sin(self.yaw_rad)
        centers: Floats = local @ np.array([[c, s], [-s, c]]) + (self.x_m, self.y_m)
        return centers


@dataclass(frozen=True, eq=False)
class OccupancyMap:
    """A map: its grid and the value of each cell."""

    grid: MapGrid
    cells: Cells
    """Shape (rows, columns); row 0 has the lowest y."""


def grid_around(static: Sequence[Solid], ground: Ground | None, resolution_m: float) -> MapGrid:
    """Return the grid around a world, with borders at multiples of the resolution.

    Raises
    ------
    UserError
        when there is nothing in the world, or it needs more cells than `MAX_CELLS`.
    """
    corners = [corner[:2] for solid in static for corner in bounds(solid)]
    if ground is not None:
        rows, columns = ground.heights.shape
        first = np.array([ground.x0_m, ground.y0_m])
        corners += [first, first + ground.cell_m * np.array([columns - 1, rows - 1])]
    if not corners:
        raise UserError("a world without solids and terrain has no map")
    touch = TOUCH_M / resolution_m
    low, high = np.min(corners, axis=0) / resolution_m, np.max(corners, axis=0) / resolution_m
    (x0, y0), (x1, y1) = np.floor(low + touch).tolist(), np.ceil(high - touch).tolist()
    columns, rows = round(x1 - x0), round(y1 - y0)
    if rows * columns > MAX_CELLS:
        raise UserError(
            f"a map of {columns} x {rows} cells is too large; expected at most {MAX_CELLS:,} "
            "cells. Fix: choose larger cells"
        )
    return MapGrid(resolution_m, x0 * resolution_m, y0 * resolution_m, 0.0, rows, columns)


def occupancy(
    grid: MapGrid, static: Sequence[Solid], ground: Ground | None, heights_m: Heights
) -> OccupancyMap:
    """Return the map of static solids and terrain.

    The terrain itself is no obstacle, however steep. On terrain the heights of a solid, or of a
    triangle of a mesh, count from the ground below its middle.
    """
    shape = grid.rows, grid.columns
    occupied, standing = np.zeros(shape, np.bool_), np.zeros(shape, np.bool_)
    if ground is not None:
        centers = grid.centers_m()
        standing |= ground.inside(centers[..., 0], centers[..., 1])
    for piece in _pieces(static, ground):
        low_m, high_m = (piece.ground_m + height for height in heights_m)
        touch_m = min(TOUCH_M, (high_m - low_m) / 2)
        obstacle = piece.between(low_m + touch_m, high_m - touch_m)
        if len(obstacle):
            _mark_overlaps(occupied, _hull(grid.in_cells(obstacle)), TOUCH_M / grid.resolution_m)
        floor_ = piece.between(-np.inf, low_m)
        if len(floor_):
            _mark_centers(standing, _hull(grid.in_cells(floor_)))
    cells = np.full(shape, UNKNOWN, np.int8)
    cells[standing] = FREE
    cells[occupied] = OCCUPIED
    return OccupancyMap(grid, cells)


@dataclass(frozen=True, eq=False)
class _Piece:
    """A convex part of a solid: a whole box or round shape, or a triangle of a mesh."""

    vertices: Floats
    edges: NDArray[np.intp]
    ground_m: float
    """Height of the ground below its middle."""

    def between(self, low_m: float, high_m: float) -> Floats:
        """Return x and y of the corners of its part between two heights, shape (N, 2)."""
        z = self.vertices[:, 2]
        if z.min() > high_m or z.max() < low_m:
            return np.empty((0, 2))
        found = [self.vertices[(z >= low_m) & (z <= high_m), :2]]
        first, second = self.vertices[self.edges[:, 0]], self.vertices[self.edges[:, 1]]
        for height_m in {low_m, high_m} - {-np.inf}:
            crosses = (first[:, 2] < height_m) != (second[:, 2] < height_m)
            a, b = first[crosses], second[crosses]
            share = (height_m - a[:, 2]) / (b[:, 2] - a[:, 2])
            found.append(a[:, :2] + share[:, None] * (b[:, :2] - a[:, :2]))
        return np.concatenate(found)


_TRIANGLE = np.array([(0, 1), (1, 2), (2, 0)])


def _pieces(static: Sequence[Solid], ground: Ground | None) -> Iterator[_Piece]:
    """Yield the convex pieces of all solids, in the world."""
    for solid in static:
        surface = triangles.merged([solid])
        vertices = surface.vertices.astype(np.float64)
        faces = surface.faces.astype(np.intp)
        if isinstance(solid.shape, Mesh):
            for corners in vertices[faces]:
                yield _Piece(corners, _TRIANGLE, _ground_below(corners, ground))
        else:
            edges = faces[:, _TRIANGLE].reshape(-1, 2)
            yield _Piece(vertices, edges, _ground_below(vertices, ground))


def _ground_below(vertices: Floats, ground: Ground | None) -> float:
    if ground is None:
        return 0.0
    x, y, _ = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    return float(np.nan_to_num(ground.height_at(x, y)))


def _hull(points: Floats) -> Floats:
    """Return the corners of the convex hull of points, shape (N, 2), counterclockwise."""
    ordered = sorted({(x, y) for x, y in points.tolist()})
    chains = []
    for chain_points in (ordered, ordered[::-1]):
        chain: list[tuple[float, float]] = []
        for x, y in chain_points:
            while len(chain) > 1:
                (ax, ay), (bx, by) = chain[-2:]
                if (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0:
                    break
                chain.pop()
            chain.append((x, y))
        chains += chain[:-1]
    return np.array(chains or ordered)


def _mark_overlaps(mask: Mask, polygon: Floats, touch: float) -> None:
    """Mark the cells that share more than `touch` with a convex polygon, along every axis."""
    low, high = polygon.min(axis=0), polygon.max(axis=0)
    slack = np.minimum(touch, (high - low) / 4) - _CLOSED
    _mark(mask, polygon, low + slack, high - slack, touch, half_cell=0.5)


def _mark_centers(mask: Mask, polygon: Floats) -> None:
    """Mark the cells whose centers lie in a convex polygon."""
    if len(polygon) > 2:
        low, high = polygon.min(axis=0), polygon.max(axis=0)
        _mark(mask, polygon, low, high, 0.0, half_cell=0.0)


def _mark(
    mask: Mask, polygon: Floats, low: Floats, high: Floats, touch: float, *, half_cell: float
) -> None:
    """Mark the cells that no edge of a polygon separates from it (separating axis theorem).

    Parameters
    ----------
    low, high
        corners of the window of cells.
    half_cell
        half the edge of the squares around the centers of cells that are compared.
    """
    rows, columns = mask.shape
    first_column, first_row = max(0, floor(low[0])), max(0, floor(low[1]))
    last_column, last_row = min(columns, ceil(high[0])), min(rows, ceil(high[1]))
    if first_column >= last_column or first_row >= last_row:
        return
    x = np.arange(first_column, last_column) + 0.5
    y = np.arange(first_row, last_row)[:, None] + 0.5
    inside = np.ones((len(y), len(x)), np.bool_)
    along = np.roll(polygon, -1, axis=0) - polygon
    for corner, (dx, dy) in zip(polygon, along, strict=True):
        length = float(np.hypot(dx, dy))
        if not length:
            continue
        outwards = np.array([dy, -dx]) / length
        border = float(corner @ outwards)
        width = border - float((polygon @ outwards).min())
        reach = half_cell * float(np.abs(outwards).sum())
        inside &= x * outwards[0] + y * outwards[1] - reach < border - (
            min(touch, width / 4) - _CLOSED
        )
    mask[first_row:last_row, first_column:last_column] |= inside
