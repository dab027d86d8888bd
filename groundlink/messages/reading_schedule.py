# SPDX-License-Identifier: Apache-2.0
"""Schedules of readings: exact conversion between reading numbers and stamps.

The model that makes a reading, the process that reports it missing and the report that counts it
use the same schedule. Faults, delays and failures do not change which readings are due.
"""

from bisect import bisect_left
from typing import Protocol

from groundlink.core.clock import Schedule


class ReadingSchedule(Protocol):
    """Schedule of the readings of one sensor, numbered on the run's time line."""

    first: int
    """First possible reading of a run, which begins at tick 0."""

    def nanos(self, reading: int) -> int:
        """Return the stamp of a reading, as sim time."""

    def at_or_after(self, nanos: int) -> int:
        """Return the first reading stamped at this sim time or later."""


class Events:
    """Schedule of readings at a fixed rate (a `ReadingSchedule`)."""

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
        """Firings of a full revolution, including those outside the field of view."""

    @property
    def firings_in_view(self) -> int:
        """Firings of a revolution within the field of view."""

    @property
    def blocks_per_revolution(self) -> int:
        """Messages per revolution."""


class Blocks:
    """Schedule of the blocks of a rotating head's revolutions (a `ReadingSchedule`).

    Blocks are numbered from the run's start, as revolutions are. A revolution that is not divided
    has one block. The stamp of a block is the time of its first firing.

    Attributes
    ----------
    per_revolution, firings_per_turn : int
        Blocks per revolution; firings per revolution, including those outside the field of view.
    first_firings : list of int
        First firing of each block of a revolution, followed by the number of firings. If the
        firings do not divide evenly, some blocks have one more than others.
    firing_times : Schedule
        Times of all these firings.
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
