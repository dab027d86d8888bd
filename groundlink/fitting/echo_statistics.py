# SPDX-License-Identifier: Apache-2.0
"""Noise, dropout and quantization of a LiDAR, out of its firings at any scene.

White noise. A laser that sweeps a plane measures 1 / range = a cos(azimuth) + b sin(azimuth) + c,
which over a few firings is a parabola. The residuals of a parabola over five firings of one laser
have two degrees of freedom; on smooth surfaces their mean square s^2 follows sigma^2 / 2 times
chi^2 of 2, whose median is 2 ln 2. The median over windows of a band of intensity and range gives
sigma, and edges, corners and grass, which are the minority, hardly count. Errors that last longer
than five firings, such as a laser's bias, are not noise here.

Dropout. Where three firings before and three after one returned from the same smooth surface, it
either returned too, or was lost.
"""

import math
from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from .firings import Firings, Reals

WINDOW = 5
BESIDE = 3
"""Firings on each side of one that may be lost."""

INTENSITIES = (0, 5, 10, 20, 40, 60, 80, 101, 256)
RANGES_M = (0, 3, 6, 12, 25, 50, 100, 250)
INCIDENCES_DEG = (0, 20, 40, 60, 75)
"""Limits of bands."""

LEAST_WINDOWS = 100
"""A standard deviation out of so many windows has an error of 7 %, 1 sigma."""

LEAST_SHOTS = 300
LEAST_PURITY = 0.75
"""Least sigma by the lower quartile, as a share of that by the median, of a band that is used."""

STEEPEST_RAD = math.radians(75)
ROUGHEST_M = 0.15
"""Residual above which a window is an edge."""

_MEDIAN = math.log(2)
"""Of chi^2 of 2 degrees of freedom, over 2."""

_LOWER_QUARTILE = -math.log(0.75)


class Windows(NamedTuple):
    """Windows of five firings of one laser on one surface, N of them."""

    curve_m: Reals
    """Shape (N, 5): the ranges of the fitted curve."""

    intensity: Reals
    """Shape (N, 5)."""

    laser: NDArray[np.intp]
    incidence_rad: Reals
    """Slant of the surface along the sweep."""

    variance_m2: Reals
    """Mean square of the residuals, per degree of freedom."""


class Shots(NamedTuple):
    """Firings between others on one smooth surface, N of them."""

    range_m: Reals
    intensity: Reals
    """Of the neighbors."""

    is_lost: NDArray[np.bool_]


class Bands(NamedTuple):
    """A figure by bands of intensity and range."""

    intensity: Reals
    """Mean of each row's data."""

    range_m: Reals
    """Mean of each column's data."""

    value: Reals
    """Shape (rows, columns); NaN where there are too few data."""

    data: NDArray[np.intp]
    """Number of data of each band."""


def _parabola(places: Reals) -> tuple[Reals, Reals]:
    """Return the projection of values at some places on parabolas, and to their coefficients."""
    basis = np.stack([np.ones_like(places), places, places**2], axis=1)
    to_coefficients: Reals = np.linalg.pinv(basis)
    return basis @ to_coefficients, to_coefficients


def find_windows(firings: Firings) -> Windows:
    """Return the windows of smooth surfaces, side by side, none of which share a firing."""
    shape = -1, firings.range_m.shape[1], WINDOW
    if len(firings.range_m) < WINDOW:
        none = np.empty((0, WINDOW))
        return Windows(none, none, np.empty(0, np.intp), none[:, 0], none[:, 0])
    ranges, intensity = (
        sliding_window_view(array, WINDOW, axis=0)[::WINDOW].reshape(shape) for array in firings[:2]
    )
    n, laser = np.nonzero((ranges > 0).all(axis=-1))
    ranges, intensity = ranges[n, laser], intensity[n, laser]
    project, to_coefficients = _parabola(np.arange(WINDOW, dtype=np.float64) - (WINDOW - 1) / 2)
    inverse = 1 / ranges
    curve = 1 / (inverse @ project.T)
    slope = -(inverse @ to_coefficients.T)[:, 1] * curve[:, WINDOW // 2] / firings.step_rad
    residual = ranges - curve
    made = Windows(
        curve, intensity, laser, np.arctan(np.abs(slope)), (residual**2).sum(axis=1) / (WINDOW - 3)
    )
    kept = (curve > 0).all(axis=1) & (np.abs(residual).max(axis=1) < ROUGHEST_M)
    kept &= made.incidence_rad < STEEPEST_RAD
    # Where the brightness changes, a band is not told by its mean.
    kept &= np.ptp(intensity, axis=1) <= 0.5 * intensity.mean(axis=1) + 3
    return Windows._make(array[kept] for array in made)


def find_shots(firings: Firings, roughest_m: float) -> Shots:
    """Return the firings between others on one smooth surface, as `Shots`.

    Parameters
    ----------
    firings : Firings
    roughest_m : float
        Root mean square of the neighbors' residuals above which a surface is not smooth.
    """
    width = 2 * BESIDE + 1
    if len(firings.range_m) < width:
        return Shots(np.empty(0), np.empty(0), np.empty(0, np.bool_))
    around = np.delete(np.arange(width), BESIDE)
    windows = sliding_window_view(firings.range_m, width, axis=0)
    n, laser = np.nonzero((windows[..., around] > 0).all(axis=-1))
    project, to_coefficients = _parabola((around - BESIDE).astype(np.float64))
    ranges = windows[n, laser]
    inverse = 1 / ranges[:, around]
    residual = ranges[:, around] - 1 / (inverse @ project.T)
    middle = 1 / (inverse @ to_coefficients.T)[:, 0]
    smooth = np.sqrt((residual**2).sum(axis=1) / (len(around) - 3)) < roughest_m
    light = sliding_window_view(firings.intensity, width, axis=0)[n, laser][:, around]
    smooth &= np.ptp(light, axis=1) <= 0.5 * light.mean(axis=1) + 3
    return Shots(middle[smooth], light.mean(axis=1)[smooth], ranges[smooth, BESIDE] == 0)


def noise_bands(windows: Windows) -> Bands:
    """Return the white noise of ranges, 1 sigma in meters, by band.

    A band is left out, as NaN, if its windows are a mixture: if surfaces are rough, or some lasers
    much noisier than others, the lower quartile of s^2 gives a smaller sigma than the median.
    """
    coordinates = windows.intensity.mean(axis=1), windows.curve_m[:, WINDOW // 2]
    sigma = np.sqrt(windows.variance_m2 / _MEDIAN)
    by_median = _banded(*coordinates, sigma, np.median, LEAST_WINDOWS)
    by_quartile = _banded(
        *coordinates,
        np.sqrt(windows.variance_m2 / _LOWER_QUARTILE),
        *(lambda values: np.quantile(values, 0.25), LEAST_WINDOWS),
    )
    pure = by_quartile.value >= LEAST_PURITY * by_median.value
    rows, columns = (np.flatnonzero(pure.any(axis=axis)) for axis in (1, 0))
    value = np.where(pure, by_median.value, np.nan)
    kept = np.ix_(rows, columns)
    return Bands(
        by_median.intensity[rows], by_median.range_m[columns], value[kept], by_median.data[kept]
    )


def expected_noise(windows: Windows, variance_m2: Reals) -> Bands:
    """Return the noise by band, 1 sigma, if each window had noise of a variance, shape (N,).

    The median m of a mixture of s^2 with these variances v solves mean(exp(-m / v)) = 1/2.
    """
    coordinates = windows.intensity.mean(axis=1), windows.curve_m[:, WINDOW // 2]
    return _banded(*coordinates, variance_m2, _mixture_stddev, LEAST_WINDOWS)


def _mixture_stddev(variance_m2: Reals) -> float:
    low, high = _MEDIAN * variance_m2.min(), _MEDIAN * variance_m2.max()
    for _ in range(30):
        middle = (low + high) / 2
        if np.exp(-middle / variance_m2).mean() > 0.5:
            low = middle
        else:
            high = middle
    return math.sqrt(high / _MEDIAN)


def dropout_bands(shots: Shots) -> Bands:
    """Return the share of lost returns by band."""
    lost = shots.is_lost.astype(float)
    return _banded(shots.intensity, shots.range_m, lost, np.mean, LEAST_SHOTS)


def noise_by_incidence(windows: Windows, noise: Bands) -> list[tuple[float, float, int]]:
    """Return for bands of incidence the noise relative to that of bands of intensity and range.

    Returns
    -------
    list of (mean incidence in degrees, ratio, windows), of bands with enough of them
    """
    of_band = at_bands(noise, windows.intensity.mean(axis=1), windows.curve_m[:, WINDOW // 2])
    relative = windows.variance_m2 / _MEDIAN / of_band**2
    degrees = np.degrees(windows.incidence_rad)
    rows = []
    for low, high in pairwise(INCIDENCES_DEG):
        own = (degrees >= low) & (degrees < high) & np.isfinite(relative)
        if own.sum() >= LEAST_WINDOWS:
            ratio = math.sqrt(np.median(relative[own]))
            rows.append((float(degrees[own].mean()), ratio, int(own.sum())))
    return rows


def intensity_by_incidence(windows: Windows) -> list[tuple[float, float, float]]:
    """Return for bands of incidence the median intensity and its spread within windows.

    Returns
    -------
    list of (mean incidence in degrees, median intensity, 1 sigma within a window over its mean)
    """
    degrees, mean = np.degrees(windows.incidence_rad), windows.intensity.mean(axis=1)
    spread = windows.intensity.std(axis=1, ddof=1) / np.maximum(mean, 1)
    rows = []
    for low, high in pairwise(INCIDENCES_DEG):
        own = (degrees >= low) & (degrees < high)
        if own.sum() >= LEAST_WINDOWS:
            figures = degrees[own].mean(), np.median(mean[own]), np.median(spread[own])
            rows.append((float(figures[0]), float(figures[1]), float(figures[2])))
    return rows


def quantization_m(firings: Firings) -> float:
    """Return the step of ranges, in meters; 0 if there is none of at least 0.5 mm."""
    ranges = np.unique(np.round(firings.range_m[firings.range_m > 0], 6))
    differences = np.diff(ranges)
    differences = differences[differences > 4e-4]
    if not len(differences):
        return 0.0
    step = float(differences.min())
    # Ranges out of float32 coordinates have errors of some micrometers.
    step = float(np.median(ranges[-1000:] / np.maximum(np.rint(ranges[-1000:] / step), 1)))
    off = np.abs(np.remainder(ranges / step + 0.5, 1) - 0.5)
    return round(step, 6) if np.mean(off < 0.05) > 0.99 else 0.0


def at_bands(bands: Bands, intensity: Reals, range_m: Reals) -> Reals:
    """Return the value of the band that each pair of numbers lies in; NaN for none."""
    table = np.full((len(INTENSITIES) - 1, len(RANGES_M) - 1), np.nan)
    rows, columns = (
        np.searchsorted(limits, means, side="right") - 1
        for limits, means in ((INTENSITIES, bands.intensity), (RANGES_M, bands.range_m))
    )
    table[np.ix_(rows, columns)] = bands.value
    row, column = (
        np.searchsorted(limits, values, side="right") - 1
        for limits, values in ((INTENSITIES, intensity), (RANGES_M, range_m))
    )
    inside = (row < table.shape[0]) & (column < table.shape[1])
    found: Reals = np.full(len(row), np.nan)
    found[inside] = table[row[inside], column[inside]]
    return found


def _banded(
    intensity: Reals,
    range_m: Reals,
    values: Reals,
    figure: Callable[[Reals], float],
    least: int,
) -> Bands:
    """Return a figure of the values in each band, without rows and columns that have none."""
    row = np.searchsorted(INTENSITIES, intensity, side="right") - 1
    column = np.searchsorted(RANGES_M, range_m, side="right") - 1
    shape = len(INTENSITIES) - 1, len(RANGES_M) - 1
    found, count = np.full(shape, np.nan), np.zeros(shape, np.intp)
    for i, j in np.ndindex(shape):
        own = (row == i) & (column == j)
        count[i, j] = own.sum()
        if count[i, j] >= least:
            found[i, j] = figure(values[own])
    enough = np.isfinite(found)
    rows, columns = (np.flatnonzero(enough.any(axis=axis)) for axis in (1, 0))
    used = np.zeros(len(row), np.bool_)
    inside = (row < shape[0]) & (column < shape[1])
    used[inside] = enough[row[inside], column[inside]]
    return Bands(
        np.array([intensity[used & (row == i)].mean() for i in rows]),
        np.array([range_m[used & (column == j)].mean() for j in columns]),
        found[np.ix_(rows, columns)],
        count[np.ix_(rows, columns)],
    )
