# SPDX-License-Identifier: Apache-2.0
"""Textures of materials, so that cameras have something to track.

Textures are computed; the same numpy gives the same bytes. A texture shows a pattern `REPEATS`
times per side, overlaid by another pattern, or the same one, at another scale. So no two places of
it look alike, and programs that recognize places recognize the right one. `patterns` defines the
patterns.
"""

from collections.abc import Callable
from functools import cache
from typing import NamedTuple
from zlib import crc32

import cv2
import numpy as np
from numpy.typing import NDArray

from groundlink.world.solids import Material, Texture

from . import patterns
from .patterns import Factors

BRIGHTEST = 2.0
"""Factor that a texel of 255 represents."""

REPEATS, REPEATS_OVER = 4, 3
"""Repetitions of the pattern and of its overlay, per side. Both end with a whole pattern."""

Pattern = Callable[[np.random.Generator], Factors]


class Look(NamedTuple):
    """Ingredients of a texture."""

    pattern: Pattern
    over: Pattern | None = None
    """Overlay, if it is not the pattern itself: wear on patterns with edges."""


_LOOKS: dict[Texture, Look] = {
    "plain": Look(patterns.plain),
    "stained": Look(patterns.stained),
    "speckled": Look(patterns.speckled),
    "wood": Look(patterns.wood),
    "brushed": Look(patterns.brushed),
    "tiles": Look(patterns.tiles, patterns.speckled),
    "bricks": Look(patterns.bricks, patterns.speckled),
    "printed": Look(patterns.printed, patterns.stained),
    "grass": Look(patterns.grass),
    "soil": Look(patterns.soil),
    "gravel": Look(patterns.gravel, patterns.soil),
    "rock": Look(patterns.rock),
    "water": Look(patterns.water),
    "leaves": Look(patterns.leaves, patterns.soil),
    "bark": Look(patterns.bark, patterns.soil),
    "roof_tiles": Look(patterns.roof_tiles, patterns.stained),
    "snow": Look(patterns.snow),
}


def period_m(material: Material) -> float:
    """Return the length after which a material's texture repeats, meters."""
    return REPEATS * material.texture_size_m


@cache
def texture(name: Texture) -> NDArray[np.uint8]:
    """Return a texture, shape (REPEATS * TEXELS,) * 2: 255 sqrt(factor / BRIGHTEST).

    The square root suits eyes and 8 bits; the shader squares it.
    """
    look = _LOOKS[name]
    generator = np.random.default_rng(crc32(name.encode()))
    pattern = look.pattern(generator)
    # Mirrored; otherwise the two would coincide where they meet.
    over = (look.over(generator) if look.over else pattern)[:, ::-1]
    factors = np.tile(pattern.astype(np.float32), (REPEATS, REPEATS))
    factors *= cv2.resize(
        np.tile(over.astype(np.float32), (REPEATS_OVER, REPEATS_OVER)), factors.shape
    )
    roots = np.sqrt(np.clip(factors, 0, BRIGHTEST) / BRIGHTEST)
    texels: NDArray[np.uint8] = np.rint(255 * roots).astype(np.uint8)
    return texels
