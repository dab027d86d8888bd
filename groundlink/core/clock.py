# SPDX-License-Identifier: Apache-2.0
"""Simulated time: integers of nanoseconds, ticks of 2.5 ms, schedules rational in ticks.

Rule: everything here is arithmetic on arguments. Nothing reads a clock or sleeps.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

TICK_NANOS = 2_500_000
"""One step of the physics engine, 2.5 ms: 400 Hz, as high-end IMUs sample (the paper, 3.3.3)."""

TICK_SECONDS = TICK_NANOS * 1e-9

NANOS = 1_000_000_000

TICK_RATE_HZ = NANOS // TICK_NANOS


def exact(value: float) -> Fraction:
    """Return the short decimal that a user wrote for `value` as an exact fraction.

    A rate of 29.97 means 2997/100, not the binary number nearest to it.
    """
    return Fraction(repr(value))


@dataclass(frozen=True)
class Schedule:
    """Events at a fixed rate on the time line of ticks, without drift.

    Event i happens at i/rate seconds of sim time: 30 Hz has events at ticks 0, 13 1/3, 26 2/3, 40.
    """

    rate_hz: Fraction

    @classmethod
    def at(cls, rate_hz: float) -> Schedule:
        """Return the schedule of a rate as it stands in a scenario."""
        return cls(exact(rate_hz))

    def nanos(self, index: int) -> int:
        """Return the sim time of event `index`, rounded down to whole nanoseconds."""
        return int(index * NANOS / self.rate_hz)

    def tick(self, index: int) -> int:
        """Return the first tick at or after event `index`: by its state it can be measured."""
        ticks = index * NANOS / (self.rate_hz * TICK_NANOS)
        return -int(-ticks // 1)

    def first_at_or_after(self, tick: int) -> int:
        """Return the index of the first event that happens at `tick` or later."""
        return self.at_or_after_nanos(tick * TICK_NANOS)

    def at_or_after_nanos(self, nanos: int) -> int:
        """Return the index of the first event that happens at a sim time or later."""
        return -int(-(nanos * self.rate_hz / NANOS) // 1)

    def between(self, tick: int, later: int) -> int:
        """Return how many events there are after that of one tick and before that of a later."""
        per_tick = self.rate_hz * TICK_NANOS / NANOS
        return max(int((later - 1) * per_tick) - int(tick * per_tick), 0)
