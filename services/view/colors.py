# SPDX-License-Identifier: Apache-2.0
"""Colours of numbers: of a LiDAR's intensities and rings, of a map's cells.

Rule: a table of 256 colours and an index into it; a colour is a number 0xRRGGBBAA.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

Colouring = Literal["intensity", "ring"]
Colours = NDArray[np.uint32]

_STOPS = (
    (0.00, (52, 58, 148)),
    (0.20, (36, 124, 214)),
    (0.42, (30, 196, 190)),
    (0.62, (112, 222, 98)),
    (0.80, (250, 204, 60)),
    (1.00, (252, 92, 56)),
)
"""From dark blue over green to red: bright enough for a dark background all the way."""

_DIFFUSE = 100.0
"""Intensity of a white surface; above it, up to 255, are retroreflectors (VLP-16 manual)."""


def _table() -> Colours:
    places, colours = zip(*_STOPS, strict=True)
    at = np.linspace(0, 1, 256)
    parts = [np.interp(at, places, part) for part in zip(*colours, strict=True)]
    return packed(np.stack(parts, axis=-1).astype(np.uint8))


def packed(rgb: NDArray[np.uint8]) -> Colours:
    """Return colours, shape (..., 3), as numbers 0xRRGGBBAA without transparency."""
    red, green, blue = np.moveaxis(rgb.astype(np.uint32), -1, 0)
    colours: Colours = (red << 24 | green << 16 | blue << 8 | 255).astype(np.uint32)
    return colours


RAINBOW = _table()


def of_points(records: NDArray[np.void], colouring: Colouring, rings: int) -> Colours:
    """Return the colour of each point, shape (N,), by its intensity or its ring of so many."""
    if colouring == "ring":
        share = records["ring"] * np.float32(1 / max(rings - 1, 1))
    else:
        share = records["intensity"] * np.float32(1 / _DIFFUSE)
    return RAINBOW[np.minimum(share * 255, 255).astype(np.uint8)]


def of_bodies(bodies: NDArray[np.uint32]) -> Colours:
    """Return the colour of each point, shape (N,), by the number of its body; neighbours differ."""
    return RAINBOW[bodies * 61 % 256]


def of_cells(cells: NDArray[np.int8]) -> NDArray[np.uint8]:
    """Return a map's cells as RGBA: white is free, black is occupied, unknown is see-through."""
    shade = (255 - np.clip(cells, 0, 100).astype(np.uint16) * 255 // 100).astype(np.uint8)
    opacity = np.where(cells < 0, 0, 255).astype(np.uint8)
    return np.stack([shade, shade, shade, opacity], axis=-1)
