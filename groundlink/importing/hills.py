# SPDX-License-Identifier: Apache-2.0
"""Generated hills: noise of several wavelengths on a grid, the same bytes on every machine.

Only sums and products of single elements are used: sines and matrix products differ in the last bit
between processors. Each octave is white noise on a coarse grid under a uniform cubic B-spline,
which is smooth to the second derivative and has little energy below its own wavelength.
"""

import numpy as np
from numpy.typing import NDArray

from .terrain_specs import HillsTerrain

_KNOTS_PER_WAVE = 2


def heights(spec: HillsTerrain) -> NDArray[np.float32]:
    """Return the heights of hills, shape (rows, columns), row 0 in the south, from 0 upwards."""
    columns, rows = (round(size / spec.cell_m) + 1 for size in spec.size_m)
    total = np.zeros((rows, columns), np.float32)
    shortest_m = spec.shortest_m or 4 * spec.cell_m
    wave_m, share, octave = spec.longest_m, 1.0, 0
    while octave == 0 or (wave_m >= shortest_m and share > 0):
        generator = np.random.Generator(np.random.PCG64([spec.seed, octave]))
        total += np.float32(share) * _octave(rows, columns, wave_m / spec.cell_m, generator)
        wave_m, share, octave = wave_m / 2, share * spec.roughness, octave + 1
    low, high = total.min(), total.max()
    total -= low
    total *= np.float32(spec.height_m) / max(high - low, np.finfo(np.float32).tiny)
    return total


def _octave(
    rows: int, columns: int, wave_cells: float, generator: np.random.Generator
) -> NDArray[np.float32]:
    """Return noise of one wavelength."""
    per_cell = _KNOTS_PER_WAVE / wave_cells
    along_rows, along_columns = (_spline(count, per_cell) for count in (rows, columns))
    shape = [int(first[-1]) + 4 for first, _ in (along_rows, along_columns)]
    knots = generator.uniform(-1.0, 1.0, shape).astype(np.float32)
    return _blended(_blended(knots, *along_rows).T, *along_columns).T


def _spline(count: int, per_cell: float) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
    """Return the first of the four knots of each of `count` places, and the weights of all four.

    The uniform cubic B-spline: (1-t)^3, 3t^3-6t^2+4, -3t^3+3t^2+3t+1, t^3, each over 6.
    """
    place = np.arange(count) * per_cell
    first = place.astype(np.intp)
    t = place - first
    weights = np.stack(
        [
            (1 - t) * (1 - t) * (1 - t),
            (3 * t - 6) * t * t + 4,
            ((3 - 3 * t) * t + 3) * t + 1,
            t * t * t,
        ]
    )
    return first, (weights / 6).astype(np.float32)


def _blended(
    knots: NDArray[np.float32], first: NDArray[np.intp], weights: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Return the spline's values along the first axis of knots."""
    total: NDArray[np.float32] = weights[0][:, None] * knots[first]
    for knot in (1, 2, 3):
        total += weights[knot][:, None] * knots[first + knot]
    return total
