# SPDX-License-Identifier: Apache-2.0
"""Ruts: how deep wheels have pressed soft terrain, on a grid that is finer than the map's.

Depths are at vertices, linear between them on the triangles of the refined cells, and below the
map's surface. Square tiles of vertices exist where ground was pressed; C reads them
(`ruts.h`). The digest of ruts follows from their content alone, however it came about.
"""

from collections.abc import Iterable
from ctypes import Structure, c_double, c_int32, c_int64, c_size_t, c_void_p
from hashlib import blake2b
from math import ceil

import numpy as np
from numpy.typing import NDArray

from groundlink.core.frames import Floats

FINEST_M = 0.05
"""Vertices are at most this far from each other, so that a narrow tire covers two in a row."""

SIDE = 16
"""Vertices along the side of a tile."""

STEP_M = 1e-4
"""Unit of depths."""

TILE = np.dtype([("key", "<i8"), ("depths", "<u2", (SIDE, SIDE))])
"""A tile in messages: its row times the number of tiles in a row, plus its column; depths in
`STEP_M`, by row (north) and column (east)."""

MOST_TILES = 1 << 14
"""Tiles of a world, 8.5 MB: the ruts of some kilometers. Later ruts do not stay."""

NO_RUTS = bytes(8)
"""Digest of ground without ruts."""

_GOLDEN = 0x9E3779B97F4A7C15
"""Of multiplicative hashing: 2 ** 64 over the golden ratio."""


def split(tiles: bytes | memoryview) -> list[bytes]:
    """Return `TILE` records one by one."""
    return [bytes(tiles[i : i + TILE.itemsize]) for i in range(0, len(tiles), TILE.itemsize)]


def digest_of(tiles: Iterable[bytes], of: bytes = NO_RUTS) -> bytes:
    """Return the digest of ruts with these tiles more than, or no longer in, those of a digest."""
    digest = int.from_bytes(of)
    for tile in tiles:
        digest ^= int.from_bytes(blake2b(tile, digest_size=len(NO_RUTS)).digest())
    return digest.to_bytes(len(NO_RUTS))


class RutGrid(Structure):
    """The depths of a terrain's ruts, at first none.

    Parameters
    ----------
    shape
        rows and columns of the map's vertices.
    cell_m, x0_m, y0_m
        of the map, see `groundlink.world.terrain.Ground`.

    Attributes
    ----------
    parts
        cells along the side of a cell of the map.
    """

    _fields_ = (
        ("_x0_m", c_double),
        ("_y0_m", c_double),
        ("cell_m", c_double),
        ("rows", c_int64),
        ("columns", c_int64),
        ("tile_columns", c_int64),
        ("_slots", c_void_p),
        ("_keys", c_void_p),
        ("_depths", c_void_p),
        ("count", c_size_t),
        ("_most", c_size_t),
        ("_shift", c_int32),
    )
    cell_m: float
    rows: int
    columns: int
    tile_columns: int
    count: int
    """Number of tiles."""

    def __init__(self, shape: tuple[int, int], cell_m: float, x0_m: float, y0_m: float) -> None:
        self.parts = max(1, ceil(cell_m / FINEST_M - 1e-9))
        rows, columns = (self.parts * (n - 1) + 1 for n in shape)
        self._slot_of: NDArray[np.int32] = np.full(2 * MOST_TILES, -1, np.int32)
        self.keys: NDArray[np.int64] = np.zeros(MOST_TILES, np.int64)
        self.depths: NDArray[np.uint16] = np.zeros((MOST_TILES, SIDE, SIDE), np.uint16)
        super().__init__(
            *(x0_m, y0_m, cell_m / self.parts, rows, columns),
            -(-columns // SIDE),
            *(kept.ctypes.data for kept in (self._slot_of, self.keys, self.depths)),
            *(0, MOST_TILES, 64 - (2 * MOST_TILES - 1).bit_length()),
        )

    def clear(self) -> None:
        """Remove all tiles."""
        self._slot_of.fill(-1)
        self.depths[: self.count] = 0
        self.count = 0

    def put(self, tiles: NDArray[np.void]) -> None:
        """Add or replace tiles, which are `TILE` records, but for those that are too many."""
        for tile in tiles:
            if (number := self._number_of(int(tile["key"]))) is not None:
                self.depths[number] = tile["depths"]

    def are_on_map(self, tiles: NDArray[np.void]) -> bool:
        """Return whether tiles lie on the map."""
        end = -(-self.rows // SIDE) * self.tile_columns
        return bool(np.all((tiles["key"] >= 0) & (tiles["key"] < end)))

    @property
    def deepest_m(self) -> float:
        """The largest depth."""
        return float(self.depths[: self.count].max(initial=0)) * STEP_M

    def are_pressed(self, x_m: Floats, y_m: Floats) -> NDArray[np.bool_]:
        """Return whether the vertices nearest to points of the world are pressed, shape (N,)."""
        column = np.floor((x_m - self._x0_m) / self.cell_m + 0.5).astype(np.int64)
        row = np.floor((y_m - self._y0_m) / self.cell_m + 0.5).astype(np.int64)
        keys = row // SIDE * self.tile_columns + column // SIDE
        order = np.argsort(self.keys[: self.count], kind="stable")
        known = self.keys[order]
        pressed = np.zeros(len(keys), np.bool_)
        if not self.count:
            return pressed
        place = np.minimum(np.searchsorted(known, keys), self.count - 1)
        inside = (row >= 0) & (row < self.rows) & (column >= 0) & (column < self.columns)
        found = np.flatnonzero(inside & (known[place] == keys))
        depths = self.depths[order[place[found]], row[found] % SIDE, column[found] % SIDE]
        pressed[found] = depths > 0
        return pressed

    def tile(self, number: int) -> bytes:
        """Return a tile as a `TILE` record."""
        record = np.empty((), TILE)
        record["key"], record["depths"] = self.keys[number], self.depths[number]
        return record.tobytes()

    def _number_of(self, key: int) -> int | None:
        """Return the number of a tile, which is added if it is new; None: there are too many."""
        slot = (key * _GOLDEN & (1 << 64) - 1) >> self._shift
        while (number := int(self._slot_of[slot])) >= 0:
            if self.keys[number] == key:
                return number
            slot = (slot + 1) % len(self._slot_of)
        if self.count == MOST_TILES:
            return None
        self._slot_of[slot], self.keys[self.count] = self.count, key
        self.count += 1
        return self.count - 1
