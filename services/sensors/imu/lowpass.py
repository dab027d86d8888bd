# SPDX-License-Identifier: Apache-2.0
"""Low-pass filter of a triad of axes: second-order Butterworth with finite memory.

The output depends only on a fixed number of past ticks, so a restarted process gives the same bytes
once it has received those ticks. Force and rate are constant within a tick. For such a signal the
weights are exactly those of the continuous filter, except for the tail, which is cut off where the
step response is within one billionth of its final value.
"""

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from groundlink.core.clock import TICK_SECONDS

from .spec import low_pass_ticks

Six = list[float]
"""Specific force x, y, z and angular rate x, y, z."""


def weights(bandwidth_hz: float) -> NDArray[np.float64]:
    """Return the filter weights at the end of a tick, newest tick first; their sum is 1.

    The weights are differences of the filter's step response, 1 - exp(-at) (cos at + sin at) with a
    = 2 pi f / sqrt(2). A bandwidth of 0 disables the filter.
    """
    if not bandwidth_hz:
        return np.ones(1)
    a = math.sqrt(2) * math.pi * bandwidth_hz
    at = a * TICK_SECONDS * np.arange(low_pass_ticks(bandwidth_hz) + 1)
    steps: NDArray[np.float64] = np.diff(1 - np.exp(-at) * (np.cos(at) + np.sin(at)))
    steps /= steps.sum()
    return steps


class LowPass(Protocol):
    """Interface of a filter for the six values of a tick."""

    ticks: int
    """Number of ticks until the first output."""

    def filtered(self, values: Six) -> Six | None:
        """Take the values of the next tick; return the filtered values, None while filling."""


class AllPass:
    """Filter that returns its input."""

    ticks = 1

    def filtered(self, values: Six) -> Six:
        """Return the values as they are."""
        return values


class Butterworth:
    """Low-pass filter with a bandwidth for each of six axes."""

    def __init__(self, bandwidths_hz: Sequence[float]) -> None:
        columns = [weights(bandwidth) for bandwidth in bandwidths_hz]
        self.ticks = max(map(len, columns))
        # Rows from the oldest tick to the newest.
        self._weights = np.stack([np.pad(c, (0, self.ticks - len(c))) for c in columns], axis=1)
        self._weights = np.ascontiguousarray(self._weights[::-1])
        # Each row is written twice, so that the newest rows are always contiguous.
        self._rows = np.zeros((2 * self.ticks, len(columns)))
        self._taken = 0

    def filtered(self, values: Six) -> Six | None:
        """Take the values of the next tick; return the filtered values, None while filling."""
        row = self._taken % self.ticks
        self._rows[row] = self._rows[row + self.ticks] = values
        self._taken += 1
        if self._taken < self.ticks:
            return None
        window = self._rows[row + 1 : row + 1 + self.ticks]
        # Summed row by row, because the order of a dot product would depend on the window's
        # position.
        out: Six = (self._weights * window).sum(axis=0).tolist()
        return out


def low_pass(force_hz: float, rate_hz: float) -> LowPass:
    """Return the filter of an IMU for its force and rate bandwidths."""
    return Butterworth([force_hz] * 3 + [rate_hz] * 3) if force_hz or rate_hz else AllPass()
