# SPDX-License-Identifier: Apache-2.0
"""Sim time: integer nanoseconds, ticks of 2.5 ms and exact schedules. Reads no clock."""

from dataclasses import dataclass
from fractions import Fraction

TICK_NANOS = 2_500_000
"""One physics step, 2.5 ms: 400 Hz, the sample rate of high-end IMUs (the paper, 3.3.3)."""

TICK_SECONDS = TICK_NANOS * 1e-9

NANOS = 1_000_000_000

TICK_RATE_HZ = NANOS // TICK_NANOS


def exact(value: float) -> Fraction:
    """Return the shortest decimal of `value` as an exact fraction: 29.97 is 2997/100."""
    return Fraction(repr(value))


@dataclass(frozen=True)
class Schedule:
    """Events at a fixed rate without drift: event i is at i/rate seconds of sim time.

    At 30 Hz, events are at ticks 0, 13 1/3, 26 2/3, 40. Arithmetic is that of integers: that of
    fractions took a quarter of an inertial unit's time.
    """

    rate_hz: Fraction

    @classmethod
    def at(cls, rate_hz: float) -> "Schedule":
        """Return the schedule of a rate from a scenario."""
        return cls(exact(rate_hz))

    def nanos(self, index: int) -> int:
        """Return the sim time of event `index`, rounded down to whole nanoseconds."""
        events, seconds = self.rate_hz.as_integer_ratio()
        return index * NANOS * seconds // events

    def tick(self, index: int) -> int:
        """Return the first tick at or after event `index`; its state completes the measurement."""
        events, seconds = self.rate_hz.as_integer_ratio()
        return -(-index * NANOS * seconds // (events * TICK_NANOS))

    def first_at_or_after(self, tick: int) -> int:
        """Return the index of the first event at or after `tick`."""
        return self.at_or_after_nanos(tick * TICK_NANOS)

    def at_or_after_nanos(self, nanos: int) -> int:
        """Return the index of the first event at or after a sim time."""
        events, seconds = self.rate_hz.as_integer_ratio()
        return -(-nanos * events // (NANOS * seconds))

    def between(self, tick: int, later: int) -> int:
        """Return the number of events strictly between the events of two ticks."""
        per_tick = self.rate_hz * TICK_NANOS / NANOS
        return max(int((later - 1) * per_tick) - int(tick * per_tick), 0)
