# SPDX-License-Identifier: Apache-2.0
"""Events of a schedule, tick by tick, for sensors that measure at single instants.

A model yields at most one measurement per state, since no rate exceeds that of ticks. Sensors that
measure over an interval (an IMU's sample, a LiDAR's block) keep their own time.
"""

from __future__ import annotations

from typing import NamedTuple

from groundlink.core.clock import Schedule


class Event(NamedTuple):
    """One event of a schedule."""

    number: int
    nanos: int
    """Its instant, in sim time."""

    tick: int
    """The first at or after it, by whose state it can be measured."""


class NextEvent:
    """The next event of a schedule."""

    def __init__(self, schedule: Schedule) -> None:
        self._schedule = schedule
        self.restart()

    def restart(self) -> None:
        """Forget earlier ticks; the next event is the first at or after the next tick."""
        self.tick = -1
        """The last one; -1 before the first. No event up to it is to come."""

        self._next: Event | None = None

    def by(self, tick: int) -> Event | None:
        """Take the next tick; return the event that can be measured by its state, if one can."""
        if self._next is None:
            self._next = self._event(self._schedule.first_at_or_after(tick))
        self.tick = tick
        due = self._next
        if tick < due.tick:
            return None
        self._next = self._event(due.number + 1)
        return due

    def _event(self, number: int) -> Event:
        return Event(number, self._schedule.nanos(number), self._schedule.tick(number))
