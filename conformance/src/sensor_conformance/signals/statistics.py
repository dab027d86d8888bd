# SPDX-License-Identifier: Apache-2.0
"""Robust figures of samples."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_NORMAL = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""


def spread(values: Floats) -> float:
    """Return a standard deviation that a few outliers don't change."""
    if not len(values):
        return float("nan")
    return float(_NORMAL * np.median(np.abs(values - np.median(values))))


def white_noise(values: Floats) -> float:
    """Return the deviation of white noise on a slowly changing signal.

    From second differences, which remove any straight line: their variance is 6 times the noise's.
    """
    return spread(np.diff(values, n=2)) / float(np.sqrt(6))


def slope(x: Floats, y: Floats) -> tuple[float, float]:
    """Return the slope of y over x through the origin, and the coefficient of correlation."""
    xx, yy, xy = float(x @ x), float(y @ y), float(x @ y)
    if xx <= 0 or yy <= 0:
        return float("nan"), 0.0
    return xy / xx, xy / float(np.sqrt(xx * yy))


def step(values: Floats) -> float:
    """Return the distance between neighboring distinct values: the resolution of a sensor.

    The 5th percentile of the distances, because rounding to float32 creates a few tiny ones.
    """
    distinct = np.unique(values[np.isfinite(values)])
    if len(distinct) < 3:
        return float("nan")
    return float(np.percentile(np.diff(distinct), 5))


def longest_constant(rows: Floats) -> int:
    """Return how many successive rows are equal in all columns, at most."""
    if not len(rows):
        return 0
    changes = np.flatnonzero(np.any(np.diff(rows, axis=0) != 0, axis=1))
    edges = np.concatenate(([-1], changes, [len(rows) - 1]))
    return int(np.diff(edges).max())
