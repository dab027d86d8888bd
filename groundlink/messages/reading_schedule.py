# SPDX-License-Identifier: Apache-2.0
"""Schedules of readings: exact arithmetic from the number of a reading to its stamp and back.

The model that makes a reading, the process that misses it and the report that counts it use the
same schedule. Faults, delays and failures do not change which readings are due.
"""

from __future__ import annotations

from bisect import bisect_left
from typing import Protocol

from groundlink.core.clock import Schedule


class ReadingSchedule(Protocol):
    """The readings of one sensor, numbered on the run's time line."""

    first: int
    """The first one that it can make of a run, which begins at tick 0."""

    def nanos(self, reading: int) -> int:
        """Return the stamp of a reading, as sim time."""

    def at_or_after(self, nanos: int) -> int:
        """Return the first reading stamped at this sim time or later."""


class Events:
    """Readings at the events of a rate (a `ReadingSchedule`)."""

    def __init__(self, rate_hz: float, first: int = 0) -> None:
        self._schedule = Schedule.at(rate_hz)
        self.first = first

    def nanos(self, reading: int) -> int:
        """Return the stamp of a reading, as sim time."""
        return self._schedule.nanos(reading)

    def at_or_after(self, nanos: int) -> int:
        """Return the first reading stamped at this sim time or later."""
        return self._schedule.at_or_after_nanos(nanos)


class TurningHead(Protocol):
    """Figures of a turning head that determine when its blocks begin."""

    @property
    def rotation_rate_hz(self) -> float:
        """Revolutions per second."""

    @property
    def firings_per_revolution(self) -> int:
        """Firings of a whole turn, those outside the view among them."""

    @property
    def firings_in_view(self) -> int:
        """Firings of a revolution that happen."""

    @property
    def blocks_per_revolution(self) -> int:
        """Messages of a revolution."""


class Blocks:
    """The blocks in which a turning head's revolutions are sent (a `ReadingSchedule`).

    Blocks are counted from the run's start, as revolutions are; a whole revolution is the only
    block of itself. A block is stamped with its first firing.

    Attributes
    ----------
    per_revolution, firings_per_turn : int
        Blocks of a revolution; firings of one, those outside the view among them.
    first_firings : list of int
        Where each block of the revolution begins, and at last the number of firings. Where these
        are no multiple of the blocks, some blocks have one more than others.
    firing_times : Schedule
        Of all these firings.
    """

    first = 0

    def __init__(self, spec: TurningHead) -> None:
        count, in_view = spec.blocks_per_revolution, spec.firings_in_view
        self.per_revolution = count
        self.first_firings = [block * in_view // count for block in range(count + 1)]
        self.firings_per_turn = spec.firings_per_revolution
        self.firing_times = Schedule(
            Schedule.at(spec.rotation_rate_hz).rate_hz * self.firings_per_turn
        )

    def nanos(self, reading: int) -> int:
        """Return the sim time of a block's first firing, rounded down."""
        revolution, index = divmod(reading, self.per_revolution)
        return self.firing_times.nanos(
            revolution * self.firings_per_turn + self.first_firings[index]
        )

    def at_or_after(self, nanos: int) -> int:
        """Return the first block that begins at this sim time or later."""
        revolution, firing = divmod(
            self.firing_times.at_or_after_nanos(nanos), self.firings_per_turn
        )
        return revolution * self.per_revolution + bisect_left(self.first_firings[:-1], firing)
