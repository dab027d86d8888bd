# SPDX-License-Identifier: Apache-2.0
"""Cover of the terrain: standing water and tall grass."""

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from groundlink.core.fields import NonNegative, Positive, Spec

from .terrain import Ground

Place2 = tuple[float, float]
"""x and y in the world."""


class WaterArea(Spec, frozen=True, kw_only=True):
    """Standing water over a rectangle of the terrain: all ground below its level is covered."""

    level_m: float
    """Height of the surface in the world. The depth is that of the ground below it."""

    low_m: Place2
    """South-west corner of the area. Its edge should be on higher ground."""

    high_m: Place2
    """North-east corner of the area."""

    material: str = "water"
    """Material of the surface; cameras and radars see it as this material."""

    wind_mps: NonNegative = 2.0
    """Wind speed, by which waves tilt the surface: a LiDAR sees it farther from the vertical."""

    def __post_init__(self) -> None:
        check_corners(self.low_m, self.high_m)


class GrassArea(Spec, frozen=True, kw_only=True):
    """Tall grass on ground of some materials of the terrain."""

    ground: Annotated[tuple[str, ...], Meta(min_length=1)]
    """Materials of the terrain on which it grows."""

    height_m: tuple[Positive, Positive]
    """Heights of the lowest and of the highest tuft. Each tuft has a height of its own between
    them."""

    leaf_area_density_per_m: Positive = 4.0
    """Area of leaves, one side, in a volume: m2 per m3. A meadow's leaf area index is this times
    its height; usual indices of meadows are 2 to 4."""

    material: str = "grass"
    """Material of the leaves."""

    low_m: Place2 = (-1e6, -1e6)
    """South-west corner of the area; default: all of the terrain."""

    high_m: Place2 = (1e6, 1e6)
    """North-east corner of the area; default: all of the terrain."""

    def __post_init__(self) -> None:
        check_corners(self.low_m, self.high_m)
        if self.height_m[0] > self.height_m[1]:
            raise ValueError("`height_m`: expected the lower height first")


def check_corners(low_m: Place2, high_m: Place2) -> None:
    """Raise ValueError for corners of a rectangle that has no area."""
    if not (low_m[0] < high_m[0] and low_m[1] < high_m[1]):
        raise ValueError("`low_m` is not south-west of `high_m`; expected lower x and y")


def grass_of_cells(areas: Sequence[GrassArea], ground: Ground) -> NDArray[np.uint8]:
    """Return for each cell of a terrain the number of its grass from 1 on, or 0.

    Shape (rows - 1, columns - 1), as `Ground.surface`. The last area with a cell counts.
    """
    rows, columns = ground.surface.shape
    x = ground.x0_m + ground.cell_m * (np.arange(columns) + 0.5)
    y = ground.y0_m + ground.cell_m * (np.arange(rows) + 0.5)
    numbers = np.zeros((rows, columns), np.uint8)
    for number, area in enumerate(areas, 1):
        grows = np.array([name in area.ground for name in ground.materials])
        in_x = (x >= area.low_m[0]) & (x <= area.high_m[0])
        in_y = (y >= area.low_m[1]) & (y <= area.high_m[1])
        numbers[grows[ground.surface] & in_x & in_y[:, None]] = number
    return numbers


TUFT_M = 0.25
"""Side of the squares in which tufts stand, along the world's axes."""


def tuft_draws(x: NDArray[np.int64], y: NDArray[np.int64]) -> NDArray[np.float32]:
    """Return a number 0..1 of each tuft, by which it has its height.

    `services/sensors/cover/cover.c` computes the same.

    Parameters
    ----------
    x, y
        its square, counted from the world's origin.
    """
    bits = x.astype(np.uint32) * np.uint32(0x9E3779B1) ^ y.astype(np.uint32) * np.uint32(0x85EBCA77)
    bits ^= bits >> np.uint32(15)
    bits *= np.uint32(0x2C1B3C6D)
    bits ^= bits >> np.uint32(12)
    bits *= np.uint32(0x297A2D39)
    bits ^= bits >> np.uint32(15)
    return (bits >> np.uint32(8)).astype(np.float32) * np.float32(2.0**-24)
