# SPDX-License-Identifier: Apache-2.0
"""The low pass of a triad of axes: Butterworth of second order, remembered for a finite time.

Rule: what comes out depends on the last so many ticks and on nothing before them, so that a
restarted process gives the same bytes once it has seen those. The force and the rate are constant
within a tick; for such a signal the weights are those of the continuous filter, exactly so but for
the tail that is cut off where a billionth of a step is left.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from groundlink.core.clock import TICK_SECONDS
from groundlink.scenario.inertial import low_pass_ticks

Six = list[float]
"""Of specific force x, y, z and angular rate x, y, z."""


def weights(bandwidth_hz: float) -> NDArray[np.float64]:
    """Return what each tick counts for at the end of a tick, the newest first; their sum is 1.

    From the filter's step response, 1 - exp(-at) (cos at + sin at) with a = 2 pi f / sqrt(2), by
    differences. A bandwidth of 0 is no filter.
    """
    if not bandwidth_hz:
        return np.ones(1)
    a = math.sqrt(2) * math.pi * bandwidth_hz
    at = a * TICK_SECONDS * np.arange(low_pass_ticks(bandwidth_hz) + 1)
    steps: NDArray[np.float64] = np.diff(1 - np.exp(-at) * (np.cos(at) + np.sin(at)))
    steps /= steps.sum()
    return steps


class LowPass(Protocol):
    """What a tick's six values go through."""

    ticks: int
    """How many it takes until something comes out."""

    def filtered(self, values: Six) -> Six | None:
        """Take the values of the next tick; return those at its end, None while it fills."""


class AllPass:
    """No filter."""

    ticks = 1

    def filtered(self, values: Six) -> Six:
        """Return the values as they are."""
        return values


class Butterworth:
    """A low pass with a bandwidth for each of six axes."""

    def __init__(self, bandwidths_hz: Sequence[float]) -> None:
        columns = [weights(bandwidth) for bandwidth in bandwidths_hz]
        self.ticks = max(map(len, columns))
        # Rows from the oldest tick to the newest.
        self._weights = np.stack([np.pad(c, (0, self.ticks - len(c))) for c in columns], axis=1)
        self._weights = np.ascontiguousarray(self._weights[::-1])
        # Each row is written twice, so that the newest so many always lie in one piece.
        self._rows = np.zeros((2 * self.ticks, len(columns)))
        self._taken = 0

    def filtered(self, values: Six) -> Six | None:
        """Take the values of the next tick; return those at its end, None while it fills."""
        row = self._taken % self.ticks
        self._rows[row] = self._rows[row + self.ticks] = values
        self._taken += 1
        if self._taken < self.ticks:
            return None
        window = self._rows[row + 1 : row + 1 + self.ticks]
        # Summed row by row: a dot product's order would depend on where the window lies.
        out: Six = (self._weights * window).sum(axis=0).tolist()
        return out


def low_pass(force_hz: float, rate_hz: float) -> LowPass:
    """Return the filter of an IMU by its two bandwidths."""
    return Butterworth([force_hz] * 3 + [rate_hz] * 3) if force_hz or rate_hz else AllPass()
