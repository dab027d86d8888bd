# SPDX-License-Identifier: Apache-2.0
"""The patterns of materials indoors and of what people make.

Rule: a pattern is a function from a generator to factors of the material's colour, shape (TEXELS,
TEXELS), with a mean near 1; it repeats without a seam. Structure at every scale, as on real
surfaces: a corner detector finds it from near and from afar.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

TEXELS = 512
"""Along each side."""

Factors = NDArray[np.float64]


def noise(
    generator: np.random.Generator,
    falloff: float,
    *,
    stretch: tuple[float, float] = (1, 1),
    lowest: float = 1,
) -> Factors:
    """Return noise whose amplitude falls with frequency to the power of `falloff`; mean 0, sigma 1.

    White noise, filtered by its Fourier transform: periodic by construction. `stretch` is by how
    much it is longer along x and y. Below the frequency `lowest` it falls no more: the less of what
    is long, the less one sees that the pattern repeats.
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
    """Return x and y of each texel's centre, 0..1, each of shape (TEXELS, TEXELS)."""
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
