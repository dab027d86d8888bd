# SPDX-License-Identifier: Apache-2.0
"""Colors of LiDAR points and map cells, as numbers 0xRRGGBBAA."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

Coloring = Literal["intensity", "ring"]
Colors = NDArray[np.uint32]

_STOPS = (
    (0.00, (52, 58, 148)),
    (0.20, (36, 124, 214)),
    (0.42, (30, 196, 190)),
    (0.62, (112, 222, 98)),
    (0.80, (250, 204, 60)),
    (1.00, (252, 92, 56)),
)
"""From dark blue to green to red, bright enough for a dark background."""

_DIFFUSE = 100.0
"""Intensity of a white surface; above it, up to 255, are retroreflectors (VLP-16 manual)."""


def _table() -> Colors:
    places, colors = zip(*_STOPS, strict=True)
    at = np.linspace(0, 1, 256)
    parts = [np.interp(at, places, part) for part in zip(*colors, strict=True)]
    return packed(np.stack(parts, axis=-1).astype(np.uint8))


def packed(rgb: NDArray[np.uint8]) -> Colors:
    """Return colors, shape (..., 3), as numbers 0xRRGGBBAA without transparency."""
    red, green, blue = np.moveaxis(rgb.astype(np.uint32), -1, 0)
    colors: Colors = (red << 24 | green << 16 | blue << 8 | 255).astype(np.uint32)
    return colors


RAINBOW = _table()


def of_points(records: NDArray[np.void], coloring: Coloring, rings: int) -> Colors:
    """Return the color of each point, shape (N,), by its intensity or its ring of so many."""
    if coloring == "ring":
        share = records["ring"] * np.float32(1 / max(rings - 1, 1))
    else:
        share = records["intensity"] * np.float32(1 / _DIFFUSE)
    return RAINBOW[np.minimum(share * 255, 255).astype(np.uint8)]


def of_bodies(bodies: NDArray[np.uint32]) -> Colors:
    """Return the color of each point, shape (N,), by the number of its body; neighbors differ."""
    return RAINBOW[bodies * 61 % 256]


def of_cells(cells: NDArray[np.int8]) -> NDArray[np.uint8]:
    """Return a map's cells as RGBA: white is free, black is occupied, unknown is transparent."""
    shade = (255 - np.clip(cells, 0, 100).astype(np.uint16) * 255 // 100).astype(np.uint8)
    opacity = np.where(cells < 0, 0, 255).astype(np.uint8)
    return np.stack([shade, shade, shade, opacity], axis=-1)
