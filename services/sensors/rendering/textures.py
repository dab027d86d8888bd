# SPDX-License-Identifier: Apache-2.0
"""The textures of materials, so that cameras have something to track.

Rule: a texture is made, not stored; the same numpy gives the same bytes. What each looks like is in
`patterns` and `patterns_outdoors`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from groundlink.world.solids import Texture

from . import patterns, patterns_outdoors
from .patterns import Factors

BRIGHTEST = 2.0
"""The factor that a texel of 255 stands for."""

_PATTERNS: dict[Texture, Callable[[np.random.Generator], Factors]] = {
    "plain": patterns.plain,
    "stained": patterns.stained,
    "speckled": patterns.speckled,
    "wood": patterns.wood,
    "brushed": patterns.brushed,
    "tiles": patterns.tiles,
    "bricks": patterns.bricks,
    "printed": patterns.printed,
    "grass": patterns_outdoors.grass,
    "soil": patterns_outdoors.soil,
    "gravel": patterns_outdoors.gravel,
    "rock": patterns_outdoors.rock,
    "water": patterns_outdoors.water,
    "leaves": patterns_outdoors.leaves,
    "bark": patterns_outdoors.bark,
    "roof_tiles": patterns_outdoors.roof_tiles,
    "snow": patterns_outdoors.snow,
}


@cache
def texture(name: Texture) -> NDArray[np.uint8]:
    """Return a pattern, shape (TEXELS, TEXELS): 255 sqrt(factor / BRIGHTEST).

    The root, as eyes and 8 bits like it; the shader squares it.
    """
    generator = np.random.default_rng(crc32(name.encode()))
    factors = np.clip(_PATTERNS[name](generator), 0, BRIGHTEST)
    texels: NDArray[np.uint8] = np.rint(255 * np.sqrt(factors / BRIGHTEST)).astype(np.uint8)
    return texels
