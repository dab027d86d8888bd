# SPDX-License-Identifier: Apache-2.0
"""Terrain for `terrain.c`: its heights, and pyramids of greatest heights.

A block of a pyramid holds the greatest height in it; the second pyramid, for rays from below, is
upside down. Both together take 2.7 bytes a cell, heights and surface 5.
"""

import ctypes
from ctypes import c_double, c_int32, c_void_p

import numpy as np
from numpy.typing import NDArray

from groundlink.world.ruts import RutGrid
from groundlink.world.terrain import Ground


class _Terrain(ctypes.Structure):
    """The structure `terrain` of `rays.h`."""

    _fields_ = (
        *((name, c_void_p) for name in ("heights", "surface")),
        ("highest", c_void_p * 2),
        *((name, c_double * 3) for name in ("origin", "per_m")),
        ("heights_within", c_double * 2),
        ("cells", c_int32 * 2),
        ("first_label", c_int32),
        ("parts", c_int32),
        ("ruts", c_void_p),
    )


class Relief:
    """A terrain that rays can hit.

    Parameters
    ----------
    ground : Ground
    first_label : int
        Label of the first of its materials; those of the others follow.
    ruts : RutGrid, optional
        After they have changed, `deepen` is to be called.

    Attributes
    ----------
    structure : ctypes.Structure
    corners : float64 array, shape (2, 3)
        Lowest and highest, in the world.
    """

    def __init__(self, ground: Ground, *, first_label: int, ruts: RutGrid | None = None) -> None:
        rows, columns = ground.heights.shape
        pyramids = _pyramid(ground.heights), _pyramid(-ground.heights)
        addresses = [(c_void_p * len(of))(*(level.ctypes.data for level in of)) for of in pyramids]
        self._kept, self._ruts = (ground, pyramids, addresses), ruts
        highest, deepest = (float(levels[-1][0, 0]) for levels in pyramids)
        ends = ground.x0_m + ground.cell_m * (columns - 1), ground.y0_m + ground.cell_m * (rows - 1)
        self.corners = np.array([(ground.x0_m, ground.y0_m, -deepest), (*ends, highest)])
        self.structure = _Terrain(
            *(ground.heights.ctypes.data, ground.surface.ctypes.data),
            (c_void_p * 2)(*map(ctypes.addressof, addresses)),
            (ground.x0_m, ground.y0_m, 0.0),
            (1 / ground.cell_m, 1 / ground.cell_m, 1.0),
            (-deepest, highest),
            (columns - 1, rows - 1),
            first_label,
            ruts.parts if ruts else 1,
            ruts and ctypes.addressof(ruts),
        )
        self._lowest_m = -deepest

    def deepen(self) -> None:
        """Let rays go down to the ruts."""
        if self._ruts is not None:
            self.structure.heights_within[0] = self._lowest_m - self._ruts.deepest_m


def _pyramid(heights: NDArray[np.float32]) -> list[NDArray[np.float32]]:
    """Return the greatest heights in blocks of cells, level by level up to a single block.

    Blocks of the first level have sides of 2 cells (`FINEST` in `terrain.c`), those of the next of
    twice as many.
    """
    cells = np.maximum(heights[:-1], heights[1:])
    levels = [_halved(np.maximum(cells[:, :-1], cells[:, 1:]))]
    while levels[-1].size > 1:
        levels.append(_halved(levels[-1]))
    return levels


def _halved(blocks: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the greatest of each 2 x 2; an odd row or column at the end counts alone."""
    for _ in range(2):  # rows, then columns
        pairs, second = blocks[::2].copy(), blocks[1::2]
        np.maximum(pairs[: len(second)], second, out=pairs[: len(second)])
        blocks = pairs.T
    return np.ascontiguousarray(blocks)
