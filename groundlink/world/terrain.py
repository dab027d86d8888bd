# SPDX-License-Identifier: Apache-2.0
"""Terrain: heights on a square grid, split into triangles.

Rows run along +y (north), columns along +x (east). With a = [row, column],
b = [row, column + 1], c = [row + 1, column] and d = [row + 1, column + 1], each cell is two
triangles, (a, b, c) and (d, c, b), counterclockwise seen from above; the diagonal runs from b
(south-east) to c (north-west).

Bullet splits the cells of its height fields in the same way: rays cast at random heights meet it
within 0.1 um of these triangles. PyBullet's `GEOM_HEIGHTFIELD` takes `heights` of R rows and
C columns as `heightfieldData=heights.ravel()`, `numHeightfieldRows=C`, `numHeightfieldColumns=R`
(x varies fastest) and `meshScale=(cell_m, cell_m, 1)`. The origin of the body is the middle of the
grid in x and y, and (lowest + highest) / 2 in z. Bullet takes at most 2,097,152 heights and drops
larger fields without an error.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from io import BytesIO
from typing import Annotated, Literal, TypeVar

import numpy as np
from msgspec import Meta, UnsetType
from numpy.typing import ArrayLike, NDArray

from groundlink.core.fields import Positive, Spec, Vector3
from groundlink.core.frames import Floats
from groundlink.world import assets
from groundlink.world.assets import Digest, MissingAsset
from groundlink.world.solids import Material

D = TypeVar("D", bound=np.generic)

HEAD_BYTES = 256
"""Upper bound for the header of a .npy file."""

BODY = "terrain"
"""The name of the terrain among bodies."""


RoughnessClass = Literal["A", "B", "C", "D", "E", "F", "G", "H"]
"""Class of a road by ISO 8608, from smooth to rough."""


class Terrain(Spec, frozen=True, kw_only=True):
    """Terrain of a resolved scenario: its position and assets."""

    heights: Digest
    """A .npy file of float32, shape (rows, columns), meters above `at_m`."""

    surface: Digest | None = None
    """A .npy file of uint8, shape (rows - 1, columns - 1): numbers of `materials`; None: all 0."""

    cell_m: Positive
    """Length of a cell's side."""

    at_m: Vector3
    """Position of the middle of the map in the world; z is added to the heights."""

    low_m: Vector3
    """Lowest corner of the box around it, in the world."""

    high_m: Vector3
    """Highest corner of that box."""

    materials: Annotated[tuple[str, ...], Meta(min_length=1, max_length=256)]
    """Names of the materials, by the numbers in `surface`."""

    def is_soft(self, materials: Mapping[str, Material]) -> bool:
        """Return whether some of it is of soil, in which ruts stay."""
        return any(not isinstance(materials[name].soil, UnsetType) for name in self.materials)


@dataclass(frozen=True, eq=False)
class Ground:
    """Terrain in memory: heights in the world and materials of the surface."""

    heights: NDArray[np.float32]
    """Shape (rows, columns), meters in the world, read-only and C-contiguous."""

    surface: NDArray[np.uint8]
    """Shape (rows - 1, columns - 1): numbers of `materials`, read-only and C-contiguous."""

    cell_m: float
    x0_m: float
    """x of the vertex [0, 0] in the world."""

    y0_m: float
    materials: tuple[str, ...]

    @property
    def grid(self) -> tuple[tuple[int, int], float, float, float]:
        """Rows and columns of vertices, cell and first vertex, as `RutGrid` takes them."""
        rows, columns = self.heights.shape
        return (rows, columns), self.cell_m, self.x0_m, self.y0_m

    def height_at(self, x_m: ArrayLike, y_m: ArrayLike) -> Floats:
        """Return the triangles' z at points of the world; NaN beside the map."""
        row, column, v, u = self._cell(x_m, y_m)
        b, c = self.heights[row, column + 1], self.heights[row + 1, column]
        south_west = u + v <= 1
        corner = np.where(south_west, self.heights[row, column], self.heights[row + 1, column + 1])
        along_x = np.where(south_west, u, 1 - v)  # the weight of b
        along_y = np.where(south_west, v, 1 - u)  # the weight of c
        height = corner.astype(np.float64)
        height = height + along_x * (b - height) + along_y * (c - height)
        return np.where(self.inside(x_m, y_m), height, np.nan)

    def material_at(self, x_m: ArrayLike, y_m: ArrayLike) -> NDArray[np.uint8]:
        """Return the numbers of the materials at points of the world; beside the map its edge's."""
        row, column, _, _ = self._cell(x_m, y_m)
        return np.asarray(self.surface[row, column])

    def inside(self, x_m: ArrayLike, y_m: ArrayLike) -> NDArray[np.bool_]:
        """Return whether points of the world lie on the map."""
        rows, columns = self.heights.shape
        u, v = self._steps(x_m, y_m)
        return np.asarray((u >= 0) & (u <= columns - 1) & (v >= 0) & (v <= rows - 1))

    def _steps(self, x_m: ArrayLike, y_m: ArrayLike) -> tuple[Floats, Floats]:
        """Return how many cells points are from the vertex [0, 0], along x and y."""
        x, y = np.asarray(x_m, np.float64), np.asarray(y_m, np.float64)
        return (x - self.x0_m) / self.cell_m, (y - self.y0_m) / self.cell_m

    def _cell(
        self, x_m: ArrayLike, y_m: ArrayLike
    ) -> tuple[NDArray[np.intp], NDArray[np.intp], Floats, Floats]:
        """Return row and column of the cells of points, and where in them along y and x, 0..1."""
        rows, columns = self.heights.shape
        u, v = np.broadcast_arrays(*self._steps(x_m, y_m))
        u, v = (np.nan_to_num(np.clip(a, 0, n - 1)) for a, n in ((u, columns), (v, rows)))
        column = np.minimum(u.astype(np.intp), columns - 2)
        row = np.minimum(v.astype(np.intp), rows - 2)
        return row, column, v - row, u - column


@lru_cache(maxsize=8)
def load_ground(terrain: Terrain) -> Ground:
    """Return a world's terrain, mapped from the store where nothing has to be added to it.

    Raises
    ------
    MissingAsset
        when the store does not hold it, or what it holds is no terrain.
    """
    heights = _array(terrain.heights, np.float32)
    rows, columns = heights.shape
    if min(rows, columns) < 2:
        raise MissingAsset(f"the terrain's heights {terrain.heights[:12]} are no map of 2 x 2")
    if terrain.at_m[2]:
        heights = heights + np.float32(terrain.at_m[2])
        heights.flags.writeable = False
    if terrain.surface is None:
        surface = np.zeros((rows - 1, columns - 1), np.uint8)
        surface.flags.writeable = False
    else:
        surface = _array(terrain.surface, np.uint8)
        if surface.shape != (rows - 1, columns - 1) or surface.max() >= len(terrain.materials):
            raise MissingAsset(f"the terrain's surface {terrain.surface[:12]} does not fit it")
    return Ground(
        heights=heights,
        surface=surface,
        cell_m=terrain.cell_m,
        x0_m=terrain.at_m[0] - (columns - 1) * terrain.cell_m / 2,
        y0_m=terrain.at_m[1] - (rows - 1) * terrain.cell_m / 2,
        materials=terrain.materials,
    )


def encode_grid(array: NDArray[np.float32] | NDArray[np.uint8]) -> bytes:
    """Return a grid as the bytes of an asset, the same for the same values on every machine."""
    file = BytesIO()
    np.lib.format.write_array(file, np.ascontiguousarray(array), version=(1, 0), allow_pickle=False)
    return file.getvalue()


def _array(digest: str, dtype: type[D]) -> NDArray[D]:
    """Return the map that an asset is, read-only, without a copy.

    Raises
    ------
    MissingAsset
        when there is none.
    """
    content = assets.map_asset(digest)
    try:
        head = BytesIO(content[:HEAD_BYTES])
        np.lib.format.read_magic(head)
        shape, by_columns, of = np.lib.format.read_array_header_1_0(head)
        flat = np.frombuffer(content, of, offset=head.tell())
        if of != dtype or by_columns or len(shape) != 2:
            raise ValueError
        return flat.reshape(shape)
    except (ValueError, TypeError):
        raise MissingAsset(f"the world's data {digest[:12]} are no map") from None
