# SPDX-License-Identifier: Apache-2.0
"""The patterns of materials outdoors: what grows, lies about, and covers roofs.

Rule: a pattern is a function from a generator to factors of the material's colour, shape (TEXELS,
TEXELS), with a mean near 1; it repeats without a seam. Structure at every scale, as on real
surfaces: a corner detector finds it from near and from afar.
"""

from __future__ import annotations

import numpy as np

from .patterns import TEXELS, Factors, grid, noise

EVEN = 8.0
"""Lowest frequency that stands out on grounds: they repeat many times in one picture."""


def _stones(generator: np.random.Generator, side: int) -> tuple[Factors, Factors, Factors]:
    """Return a mosaic of `side` by `side` cells, whose shapes are those of stones that lie close.

    For each texel: how far its cell's middle is and how much farther the next one, both in sides of
    a cell, and a number of the cell, 0..1.
    """
    shift_x, shift_y, shades = generator.random((3, side, side))
    x, y = (side * at for at in grid())
    column, row = x.astype(int), y.astype(int)
    nearest, second = np.full((2, TEXELS, TEXELS), np.inf)
    shade = np.zeros((TEXELS, TEXELS))
    for down in (-1, 0, 1):
        for right in (-1, 0, 1):
            # The pattern repeats: beyond the last cell is the first one.
            cell = (row + down) % side, (column + right) % side
            apart = np.hypot(column + right + shift_x[cell] - x, row + down + shift_y[cell] - y)
            second = np.minimum(second, np.maximum(apart, nearest))
            shade = np.where(apart < nearest, shades[cell], shade)
            nearest = np.minimum(nearest, apart)
    return nearest, second - nearest, shade


def grass(generator: np.random.Generator) -> Factors:
    """Blades and tufts, light and dark, and gaps between them."""
    blades = noise(generator, 0.3, stretch=(1, 4)) + noise(generator, 0.3, stretch=(4, 1))
    made = 1.04 + 0.14 * blades + 0.10 * noise(generator, 0.8, lowest=EVEN)
    gaps = noise(generator, 0.8, lowest=EVEN)
    made -= 0.45 * np.clip(gaps - 1.2, 0, 1) - 0.3 * (noise(generator, 0.6) > 2.4)
    return np.asarray(made)


def soil(generator: np.random.Generator) -> Factors:
    """Earth: clods, crumbs, and a few light stones."""
    made = 1 + 0.12 * noise(generator, 0.9, lowest=EVEN) + 0.12 * noise(generator, 0.6)
    stones, holes = (
        noise(generator, 1.0, lowest=EVEN) > 2.3,
        noise(generator, 0.9, lowest=EVEN) > 2.1,
    )
    return np.asarray(made + 0.35 * stones - 0.3 * holes)


def gravel(generator: np.random.Generator) -> Factors:
    """Stones, 40 to a side, each of its own shade, with dark between them."""
    _, gap, shade = _stones(generator, 40)
    made = 0.80 + 0.5 * shade + 0.08 * noise(generator, 0.6)
    return np.asarray(made * np.clip(0.45 + 3.0 * gap, 0.45, 1.1))


def rock(generator: np.random.Generator) -> Factors:
    """Bare rock: layers, lichen, and cracks."""
    layers = noise(generator, 0.9, stretch=(2, 1), lowest=EVEN)
    made = 1 + 0.14 * layers + 0.12 * noise(generator, 0.7)
    cracks = np.abs(noise(generator, 1.5, lowest=EVEN)) < 0.035
    lichen = noise(generator, 1.1, lowest=EVEN) > 1.9
    return np.asarray(made - 0.35 * cracks + 0.25 * lichen)


def water(generator: np.random.Generator) -> Factors:
    """Ripples on a pond."""
    return 1 + 0.16 * noise(generator, 1.6, stretch=(3, 1)) + 0.05 * noise(generator, 0.8)


def leaves(generator: np.random.Generator) -> Factors:
    """Foliage: leaves in the light over leaves in the shade."""
    middle, gap, shade = _stones(generator, 27)
    made = 0.85 + 1.0 * shade - 0.7 * middle + 0.15 * noise(generator, 0.9)
    return np.asarray(made * np.clip(0.6 + 3 * gap, 0.6, 1.05))


def bark(generator: np.random.Generator) -> Factors:
    """Furrows along x."""
    furrows = noise(generator, 1.0, stretch=(10, 1))
    made: Factors = 1 + 0.22 * noise(generator, 1.2, stretch=(4, 1)) + 0.08 * noise(generator, 0.5)
    return made - 0.45 * (furrows < -0.9)


def roof_tiles(generator: np.random.Generator) -> Factors:
    """Eight rows of twelve tiles, each row over the edge of the next, which is in its shadow."""
    x, y = grid()
    row = (8 * y).astype(int)
    along = 12 * x + 0.5 * (row % 2)
    shade = generator.uniform(-0.2, 0.2, (8, 12))[row, along.astype(int) % 12]
    bulge = np.cos(2 * np.pi * (along % 1 - 0.5))
    made = 1 + shade + 0.14 * bulge + 0.07 * noise(generator, 0.8)
    down = 8 * y % 1
    return np.where(down > 0.86, 0.45, made + 0.15 * (0.5 - down))


def snow(generator: np.random.Generator) -> Factors:
    """Drifts, and crystals that glitter."""
    made = 1 + 0.05 * noise(generator, 1.8, lowest=EVEN) + 0.03 * noise(generator, 0.5)
    return made - 0.12 * (noise(generator, 0.9, lowest=EVEN) > 2.5)
