# SPDX-License-Identifier: Apache-2.0
"""Roughness of ground by the classes A to H of ISO 8608: heights below the resolution of maps.

The spectrum of heights along any straight line is that of the standard: Gd(n) = Gd(n0) (n/n0)^-2 at
n cycles per meter. Longer waves than those of `LOWEST_CPM` belong to the terrain or to solids.
"""

from collections.abc import Callable
from typing import get_args
from zlib import crc32

import numpy as np

from .terrain import RoughnessClass

REFERENCE_CPM = 0.1
"""n0 of ISO 8608, cycles per meter."""

CLASS_A_M3 = 16e-6
"""Gd(n0) of class A: the geometric mean of ISO 8608, table C.1. Each class has four times as much
as the one before."""

LOWEST_CPM = 0.05
"""Lowest spatial frequency; ISO 8608 needs none below for vehicles off the road."""

HIGHEST_CPM = 10.0
"""Highest spatial frequency: the upper limit that ISO 8608 recommends for the envelope of a tire.
"""

CELL_M = 0.05
CELLS = 1024
"""Heights along a side of the tile that repeats: 51.2 m."""


Roughness = Callable[[str], float]
"""Heights of a material's roughness, in units of those of class A; 0 for a smooth one."""


def smooth(material: str) -> float:
    """Return zero."""
    return 0.0


def roughness_of(classes: RoughnessClass | dict[str, RoughnessClass] | None) -> Roughness:
    """Return the roughness of materials by the class of all of them, or by their classes."""
    if classes is None:
        return smooth
    if isinstance(classes, str):
        of_all = _amplitude(classes)
        return lambda material: of_all
    amplitudes = {material: _amplitude(of_it) for material, of_it in classes.items()}
    return lambda material: amplitudes.get(material, 0.0)


def _amplitude(of_class: RoughnessClass) -> float:
    """Return the ratio of a class's heights to those of class A: 2 from one to the next."""
    return float(2 ** get_args(RoughnessClass).index(of_class))


class RoughGround:
    """Heights of ground of class A around z = 0, a function of seed and place.

    White noise on a tile is filtered to the spectrum S(n) = C n^-3 / 4 in two dimensions, whose
    integral across a line is the one-sided C n^-2 along it. A cubic B-spline joins the heights, so
    that they have continuous slopes; the filter makes up for the spline's own attenuation.
    """

    def __init__(self, seed: int) -> None:
        generator = np.random.default_rng([seed, crc32(b"roughness")])
        white = np.fft.rfft2(generator.standard_normal((CELLS, CELLS)))
        along_y = np.fft.fftfreq(CELLS, CELL_M)[:, None]
        along_x = np.fft.rfftfreq(CELLS, CELL_M)[None, :]
        frequency = np.hypot(along_x, along_y)
        inside = (frequency >= LOWEST_CPM) & (frequency <= HIGHEST_CPM)
        density = CLASS_A_M3 * REFERENCE_CPM**2 / 4 * np.where(inside, frequency, np.inf) ** -3.0
        spline = (np.sinc(along_x * CELL_M) * np.sinc(along_y * CELL_M)) ** 4
        heights = np.fft.irfft2(white * np.sqrt(density) / (CELL_M * spline))
        # Three rows and columns more, so that no spline reaches over the tile's edge.
        self._heights = np.pad(heights, (0, 3), mode="wrap").ravel().data

    def height_m(self, x_m: float, y_m: float) -> float:
        """Return the height at a place, m."""
        column, row = x_m / CELL_M, y_m / CELL_M
        left, below = int(column // 1), int(row // 1)
        a, b, c, d = _spline(column - left)
        stride = CELLS + 3
        first = below % CELLS * stride + left % CELLS
        height = 0.0
        for weight in _spline(row - below):
            h, i, j, k = self._heights[first : first + 4]
            height += weight * (a * h + b * i + c * j + d * k)
            first += stride
        return height


def _spline(t: float) -> tuple[float, float, float, float]:
    """Return the weights of the four heights around a place, 0 <= t < 1."""
    u = 1.0 - t
    return (
        u * u * u / 6,
        (4 - 3 * t * t * (2 - t)) / 6,
        (4 - 3 * u * u * (2 - u)) / 6,
        t * t * t / 6,
    )
