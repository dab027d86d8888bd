# SPDX-License-Identifier: Apache-2.0
"""Delays between signals, and shifts between profiles."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def delay(
    first: tuple[Floats, Floats], second: tuple[Floats, Floats], most: float, step: float
) -> tuple[float, Floats, Floats]:
    """Return the delay of the second signal behind the first, by cross-correlation.

    Parameters
    ----------
    first, second
        Times in seconds and values. Times need no common rate.
    most
        Longest delay to test, in seconds.
    step
        Spacing of the tested delays; a parabola through the best three refines the result.

    Returns
    -------
    tuple
        Delay in seconds, tested delays, and the correlation at each. NaN if signals don't overlap.
    """
    (time_1, value_1), (time_2, value_2) = first, second
    tests = np.arange(-round(most / step), round(most / step) + 1)
    delays = np.asarray(tests * step, np.float64)
    start = max(time_1[0], time_2[0]) + most
    end = min(time_1[-1], time_2[-1]) - most
    inside = (time_2 - delays[0] <= time_1[-1]) & (time_2 >= start) & (time_2 <= end)
    if np.count_nonzero(inside) < 10:
        return float("nan"), delays, np.zeros(len(delays))
    times, values = time_2[inside], value_2[inside] - np.mean(value_2[inside])
    shifted = np.interp(times[None, :] - delays[:, None], time_1, value_1)
    shifted = shifted - shifted.mean(axis=1, keepdims=True)
    power = np.sqrt(np.sum(shifted**2, axis=1) * float(values @ values))
    scores = np.divide(shifted @ values, power, out=np.zeros(len(delays)), where=power > 0)
    best = int(np.argmax(scores))
    found = float(delays[best])
    if 0 < best < len(delays) - 1:
        before, at, after = scores[best - 1 : best + 2]
        if (curvature := before - 2 * at + after) < 0:
            found += float(0.5 * (before - after) / curvature) * step
    return found, delays, np.asarray(scores, np.float64)


def shift(before: Floats, after: Floats, most: int, circular: bool) -> tuple[float, float]:
    """Return by how many elements a profile moved towards higher indexes, and how alike they are.

    Parameters
    ----------
    before, after
        Profiles of the same length; NaN where nothing was measured.
    most
        Largest shift to test.
    circular
        Whether the last element is a neighbor of the first.

    Returns
    -------
    tuple
        Shift in elements, refined by a parabola; and the correlation there, up to 1.
    """
    shifts = np.arange(-most, most + 1)
    index = np.arange(len(after))
    source = index[None, :] - shifts[:, None]
    valid = np.ones(source.shape, bool)
    if circular:
        source = source % len(before)
    else:
        valid = (source >= 0) & (source < len(before))
        source = source.clip(0, len(before) - 1)
    old = before[source]
    valid &= np.isfinite(old) & np.isfinite(after)[None, :]
    count = np.maximum(valid.sum(axis=1), 1)
    difference = np.where(valid, np.abs(old - after[None, :]), 0)
    # The mean absolute difference has a sharp minimum, also where edges of objects dominate.
    costs = difference.sum(axis=1) / count
    costs = np.where(valid.sum(axis=1) > 0.3 * len(after), costs, np.inf)
    best = int(np.argmin(costs))
    if not np.isfinite(costs[best]):
        return float("nan"), 0.0
    found = float(shifts[best])
    if 0 < best < len(costs) - 1 and np.isfinite(costs[[best - 1, best + 1]]).all():
        left, at, right = costs[best - 1 : best + 2]
        if (side := max(left, right) - at) > 0:  # vertex of a V with equal slopes
            found += float(0.5 * (left - right) / side)
    pair = valid[best]
    a, b = old[best][pair], after[pair]
    if np.std(a) == 0 or np.std(b) == 0:
        return found, 0.0
    return found, float(np.corrcoef(a, b)[0, 1])
