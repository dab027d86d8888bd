# SPDX-License-Identifier: Apache-2.0
"""Texture patterns of materials.

A pattern is a function from a generator to factors of the material's color, shape (TEXELS, TEXELS),
with a mean near 1; it repeats without a seam. Patterns have structure at every scale, like real
surfaces, so corner detectors find features from near and far.
"""

import numpy as np
from numpy.typing import NDArray

TEXELS = 512
"""Along each side."""

Factors = NDArray[np.float64]

EVEN = 8.0
"""Lowest dominant frequency of ground patterns, which repeat many times in a picture."""


def noise(
    generator: np.random.Generator,
    falloff: float,
    *,
    stretch: tuple[float, float] = (1, 1),
    lowest: float = 1,
) -> Factors:
    """Return noise whose amplitude falls with frequency to the power of `falloff`; mean 0, sigma 1.

    White noise filtered in the frequency domain, so it is periodic. `stretch` scales the noise
    along x and y. Below the frequency `lowest` the amplitude is constant, which hides repetition.
    """
    along = np.fft.rfftfreq(TEXELS) * TEXELS * stretch[0]
    across = np.fft.fftfreq(TEXELS) * TEXELS * stretch[1]
    frequency = np.hypot(along[None, :], across[:, None])
    frequency[0, 0] = np.inf
    white = np.fft.rfft2(generator.standard_normal((TEXELS, TEXELS)))
    made = np.fft.irfft2(white / np.maximum(frequency, lowest) ** falloff, (TEXELS, TEXELS))
    scaled: Factors = made / made.std()
    return scaled


def grid() -> tuple[Factors, Factors]:
    """Return x and y of each texel's center, 0..1, each of shape (TEXELS, TEXELS)."""
    at = (np.arange(TEXELS) + 0.5) / TEXELS
    return np.broadcast_to(at, (TEXELS, TEXELS)), np.broadcast_to(at[:, None], (TEXELS, TEXELS))


def plain(generator: np.random.Generator) -> Factors:
    """Paint: hardly any structure."""
    return 1 + 0.04 * noise(generator, 1.0)


def stained(generator: np.random.Generator) -> Factors:
    """Walls: clouds, fine grain, and a few dark scuffs and dots."""
    made = 1 + 0.06 * noise(generator, 1.6) + 0.08 * noise(generator, 0.7)
    marks = noise(generator, 0.9, stretch=(3, 1))
    scuffed: Factors = made - 0.8 * np.clip(marks - 2.1, 0, 0.6)
    return scuffed


def speckled(generator: np.random.Generator) -> Factors:
    """Linoleum, asphalt, terrazzo: light and dark chips in a mottled ground."""
    chips = noise(generator, 0.9)
    made = 1 + 0.10 * noise(generator, 1.3) + 0.06 * noise(generator, 0.3)
    return made + 0.30 * ((chips > 2.0).astype(float) - (chips < -2.0))


def wood(generator: np.random.Generator) -> Factors:
    """Grain along x: wavy year rings and pores."""
    _, y = grid()
    wave = noise(generator, 1.8, stretch=(8, 1))
    rings = np.sin(2 * np.pi * (9 * y + 0.35 * wave))
    pores = noise(generator, 0.5, stretch=(24, 1))
    made: Factors = 1 + 0.16 * rings + 0.10 * pores + 0.08 * noise(generator, 1.5)
    return made


def brushed(generator: np.random.Generator) -> Factors:
    """Metal: strokes along x and a few scratches and spots."""
    strokes = noise(generator, 0.4, stretch=(40, 1))
    spots = noise(generator, 1.1)
    return 1 + 0.07 * strokes + 0.05 * noise(generator, 1.5) - 0.25 * (spots > 2.6)


def tiles(generator: np.random.Generator) -> Factors:
    """Four by four tiles, no two alike, with dark joints."""
    x, y = grid()
    column, row = (4 * x).astype(int), (4 * y).astype(int)
    shade = generator.uniform(-0.16, 0.16, (4, 4))[row, column]
    to_joint = np.minimum(*(np.abs(np.mod(4 * at + 0.5, 1) - 0.5) for at in (x, y)))
    chips = noise(generator, 0.8)
    made = 1 + shade + 0.09 * noise(generator, 0.8)
    made += 0.4 * ((chips > 2.1).astype(float) - (chips < -2.1))
    return np.where(to_joint < 0.012, 0.45, made)


def bricks(generator: np.random.Generator) -> Factors:
    """Walls: 12 courses of 4 bricks in running bond, light mortar."""
    x, y = grid()
    row = (12 * y).astype(int)
    along = 4 * x + 0.5 * (row % 2)
    shade = generator.uniform(-0.25, 0.25, (12, 4))[row, along.astype(int) % 4]
    to_joint = np.minimum(
        3 * np.abs(np.mod(along + 0.5, 1) - 0.5), np.abs(np.mod(12 * y + 0.5, 1) - 0.5)
    )
    made = 1 + shade + 0.10 * noise(generator, 0.8)
    return np.where(to_joint < 0.08, 1.35 + 0.08 * noise(generator, 0.5), made)


def printed(generator: np.random.Generator) -> Factors:
    """Return labels, prints and a strip of tape on cardboard."""
    made = 1 + 0.05 * noise(generator, 0.8)
    for _ in range(14):
        width, height = generator.integers(20, 120), generator.integers(12, 70)
        left, top = generator.integers(0, TEXELS - width), generator.integers(0, TEXELS - height)
        label = made[top : top + height, left : left + width]
        label[:] = generator.choice([0.35, 0.55, 1.5, 1.8])
        ink = generator.random((height // 5 + 1, width // 4 + 1)) < 0.45
        cells = np.repeat(np.repeat(ink, 5, axis=0), 4, axis=1)[:height, :width]
        label[3:-3, 3:-3] = np.where(cells, 0.25, label)[3:-3, 3:-3]
    made[:, 240:272] *= 1.25
    return made


def _stones(generator: np.random.Generator, side: int) -> tuple[Factors, Factors, Factors]:
    """Return a mosaic of `side` by `side` cells, shaped like closely packed stones.

    For each texel: the distance to the middle of its cell, the additional distance to the next
    middle (both in sides of a cell), and a random shade of the cell, 0..1.
    """
    shift_x, shift_y, shades = generator.random((3, side, side))
    x, y = (side * at for at in grid())
    column, row = x.astype(int), y.astype(int)
    nearest, second = np.full((2, TEXELS, TEXELS), np.inf)
    shade = np.zeros((TEXELS, TEXELS))
    for down in (-1, 0, 1):
        for right in (-1, 0, 1):
            # The pattern repeats: the last cell is followed by the first.
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
    """Eight rows of twelve overlapping tiles; each row shades the next."""
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
