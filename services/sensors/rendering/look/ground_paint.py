# SPDX-License-Identifier: Apache-2.0
"""Colors and sunlight of a terrain's cells.

Both depend on the terrain, its materials and the sun only, and are computed once. Shadows of hills
are computed here, in steps of a cell. They don't darken objects that stand in them.
"""

import math
from collections.abc import Mapping

import cv2
import numpy as np
from numpy.typing import NDArray

from groundlink.core.frames import Floats
from groundlink.world.solids import Material
from groundlink.world.terrain import Ground

from .patterns import TEXELS, noise

MOTTLED = 0.14
"""Standard deviation of the brightness of cells of one material: no meadow is uniform."""

PENUMBRA = 0.06
"""Width of a shadow's edge, as a share of the light's path along the ground."""

Heights = NDArray[np.float32]


def colors(ground: Ground, materials: Mapping[str, Material]) -> NDArray[np.uint8]:
    """Return the square roots of each cell's linear color, shape (rows - 1, columns - 1, 3)."""
    palette = np.array([materials[name].color for name in ground.materials], np.float32)
    rows, columns = ground.surface.shape
    mottle = 1 + MOTTLED * noise(np.random.default_rng(0), 0.7)
    tiled = np.sqrt(np.clip(mottle, 0.5, 1.5)).astype(np.float32)
    made = np.empty((rows, columns, 3), np.uint8)
    across = np.arange(columns) % TEXELS
    for row in range(rows):
        roots = np.sqrt(palette)[ground.surface[row]] * tiled[row % TEXELS, across, None]
        made[row] = np.rint(255 * np.minimum(roots, 1))
    return made


def sunlit(ground: Ground, towards_sun: Floats) -> NDArray[np.uint8]:
    """Return the share of sunlight that each cell receives, 255 for all of it."""
    heights, cell_m = ground.heights, ground.cell_m
    x, y, z = towards_sun.tolist()
    across = (heights[:-1, 1:] + heights[1:, 1:]) - (heights[:-1, :-1] + heights[1:, :-1])
    along = (heights[1:, :-1] + heights[1:, 1:]) - (heights[:-1, :-1] + heights[:-1, 1:])
    across /= 2 * cell_m
    along /= 2 * cell_m
    shares = (z - x * across - y * along) / np.sqrt(1 + across**2 + along**2)
    lit = _lit(heights, cell_m, towards_sun)
    if lit is not None:
        shares *= (lit[:-1, :-1] + lit[:-1, 1:] + lit[1:, :-1] + lit[1:, 1:]) / 4
    texels: NDArray[np.uint8] = np.rint(255 * np.clip(shares, 0, 1)).astype(np.uint8)
    return texels


def _lit(heights: Heights, cell_m: float, towards_sun: Floats) -> Heights | None:
    """Return how far each vertex is outside the shadows of hills, 0..1; None without any.

    The highest line of sight over 2 n cells is the higher one of that over the first n cells and
    that over the next n cells. So few steps cover a long distance.
    """
    x, y, z = towards_sun.tolist()
    level = math.hypot(x, y)
    if level < 1e-3:
        return None
    rise_m = cell_m * z / level
    steps = float(np.ptp(heights)) / rise_m
    if steps < 1:
        return None

    def seen_from(reach: float, above: Heights) -> Heights:
        """Return the values that many cells towards the sun, lowered by the sun's elevation."""
        moved = np.array([[1, 0, reach * x / level], [0, 1, reach * y / level]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        shifted = cv2.warpAffine(
            above, moved, above.shape[::-1], flags=flags, borderMode=cv2.BORDER_REPLICATE
        )
        return np.asarray(shifted, np.float32) - np.float32(reach * rise_m)

    reach = 1.0
    above = seen_from(reach, heights)
    while reach < steps:
        above = np.maximum(above, seen_from(reach, above))
        reach *= 2
    lit: Heights = np.clip(0.5 + (heights - above) / (2 * PENUMBRA * 4 * rise_m), 0, 1)
    return lit
