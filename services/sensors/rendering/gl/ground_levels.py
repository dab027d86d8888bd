# SPDX-License-Identifier: Apache-2.0
"""Levels of detail of a terrain: fine triangles near the eye, coarse triangles far away.

Near the eye the triangles are those that rays hit; farther away their surface differs by less than
half a pixel. A patch has `SIDE` by `SIDE` cells. On level n a cell spans 2 ** n cells of the
terrain, less at the far edges of the map. Errors are upper bounds.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from groundlink.core.frames import Floats
from groundlink.world.terrain import Ground

from .culling import Boxes, seen

SIDE = 12
"""Cells along the side of a patch."""

EXACT_M = 12.0
"""Distance up to which all triangles are the terrain's own. At a flat angle coarse triangles would
look right, but their depth would not be right."""

HALF_PIXEL = 0.5

STEPS = 2
"""Levels between two that are compared; the errors of such steps are summed."""

Heights = NDArray[np.float32]


class Level(NamedTuple):
    """All patches of one size, row by row."""

    stride: int
    """Cells of the terrain along one cell of a patch."""

    columns: int
    """Bounding boxes of the patches."""

    error_m: Heights
    """Largest distance of each patch from the terrain, shape (patches,)."""

    boxes: Boxes


class Levels:
    """The patches of a terrain."""

    def __init__(self, ground: Ground) -> None:
        self._levels = list(_levels(ground))[::-1]

    def shown(self, clip_from_world: Floats, eye: Floats, focal_px: float) -> NDArray[np.int32]:
        """Return the patches that a view needs, nearest first.

        Returns
        -------
        int32 array, shape (patches, 3)
            Column and row of the first vertex, and terrain cells along each cell of the patch.
        """
        numbers = np.arange(len(self._levels[0].error_m))
        found, distances_m = [], []
        for level, finer in zip(self._levels, [*self._levels[1:], None], strict=True):
            numbers = numbers[seen(level.boxes.picked(numbers), clip_from_world)]
            away_m = level.boxes.picked(numbers).away(eye)
            allowed_m = np.where(away_m > EXACT_M, HALF_PIXEL / focal_px * away_m, 0.0)
            good = (level.error_m[numbers] <= allowed_m) | (finer is None)
            row, column = np.divmod(numbers, level.columns)
            first = SIDE * level.stride * np.stack([column, row], axis=-1)[good]
            found.append(np.insert(first, 2, level.stride, axis=1))
            distances_m.append(away_m[good])
            if finer is not None:
                numbers = _quarters(row[~good], column[~good], finer)
        nearest_first = np.argsort(np.concatenate(distances_m), kind="stable")
        return np.concatenate(found)[nearest_first].astype(np.int32)


def _quarters(row: NDArray[np.intp], column: NDArray[np.intp], finer: Level) -> NDArray[np.intp]:
    """Return the indices of the next finer level's patches inside some patches of this level."""
    rows = (2 * row[:, None] + (0, 0, 1, 1)).ravel()
    columns = (2 * column[:, None] + (0, 1, 0, 1)).ravel()
    there = (columns < finer.columns) & (rows * finer.columns < len(finer.error_m))
    return (rows * finer.columns + columns)[there]


def _levels(ground: Ground) -> Iterator[Level]:
    """Yield the levels of a terrain, finest first."""
    heights = ground.heights
    low, high = _over_cells(np.minimum, heights), _over_cells(np.maximum, heights)
    errors_m = [np.zeros_like(low)]  # of the cells of each level
    while True:
        stride = 1 << (len(errors_m) - 1)
        lowest, highest, worst = (
            _blocks(combine, of, SIDE)
            for combine, of in ((np.minimum, low), (np.maximum, high), (np.maximum, errors_m[-1]))
        )
        boxes = _boxes(ground, stride, lowest, highest)
        yield Level(stride, worst.shape[1], worst.ravel(), boxes)
        if worst.size == 1:
            return
        low, high = _blocks(np.minimum, low, 2), _blocks(np.maximum, high, 2)
        finer = min(len(errors_m), STEPS)
        apart_m = _apart(heights, 2 * stride, finer)
        errors_m.append(apart_m + _blocks(np.maximum, errors_m[-finer], 1 << finer))


def _over_cells(combine: np.ufunc, heights: Heights) -> Heights:
    """Return the minimum or maximum over each cell's corners."""
    along: Heights = combine(heights[:, :-1], heights[:, 1:])
    over: Heights = combine(along[:-1], along[1:])
    return over


def _blocks(combine: np.ufunc, values: Heights, side: int) -> Heights:
    """Return the minimum or maximum of each block of `side` by `side`; far edges have fewer."""
    for axis in (0, 1):
        values = combine.reduceat(values, np.arange(0, values.shape[axis], side), axis=axis)
    return values


def _boxes(ground: Ground, stride: int, low: Heights, high: Heights) -> Boxes:
    """Return the boxes around the patches of a level."""
    row, column = (each.ravel() for each in np.indices(low.shape))
    rows, columns = ground.heights.shape
    edge = SIDE * stride
    (west, east), (south, north) = (
        (start + ground.cell_m * np.array([edge * i, np.minimum(edge * (i + 1), count - 1)]))
        for start, i, count in ((ground.x0_m, column, columns), (ground.y0_m, row, rows))
    )
    lows, highs = (west, south, low.ravel()), (east, north, high.ravel())
    return Boxes.around(*(np.stack(corner, axis=-1).astype(np.float64) for corner in (lows, highs)))


def _apart(heights: Heights, stride: int, steps: int) -> Heights:
    """Return an upper bound of the distance of cells from the same cells halved `steps` times."""
    numbers = [np.append(np.arange(0, n - 1, stride), n - 1) for n in heights.shape]
    mesh = heights[np.ix_(*numbers)]
    for step in range(1, steps + 1):
        # The last cell may be shorter; the vertex that halves it may then be anywhere in it, or its
        # end.
        halves = [np.arange(2 * len(of) - 1) * (stride >> step) for of in numbers]
        halves = [np.minimum(of, n - 1) for of, n in zip(halves, heights.shape, strict=True)]
        mesh = _halved(mesh, *halves)
        numbers = halves
    apart = np.abs(mesh - heights[np.ix_(*numbers)])
    return _blocks(np.maximum, _over_cells(np.maximum, apart), 1 << steps)


def _halved(mesh: Heights, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> Heights:
    """Return the same surface with one more vertex on each edge.

    `rows` and `columns` index all vertices. The diagonal of a cell runs from its south-east corner
    to its north-west corner, as in the terrain.
    """
    v, u = (
        ((of[1::2] - of[:-2:2]) / np.maximum(of[2::2] - of[:-2:2], 1)).astype(np.float32)
        for of in (rows, columns)
    )
    v = v[:, None]
    a, b, c, d = mesh[:-1, :-1], mesh[:-1, 1:], mesh[1:, :-1], mesh[1:, 1:]
    south_west = a + u * (b - a) + v * (c - a)
    north_east = d + (1 - u) * (c - d) + (1 - v) * (b - d)
    halved = np.empty((len(rows), len(columns)), np.float32)
    halved[::2, ::2] = mesh
    halved[::2, 1::2] = mesh[:, :-1] + u * np.diff(mesh, axis=1)
    halved[1::2, ::2] = mesh[:-1] + v * np.diff(mesh, axis=0)
    halved[1::2, 1::2] = np.where(u + v <= 1, south_west, north_east)
    return halved
