# SPDX-License-Identifier: Apache-2.0
"""Schedule events by tick, for sensors that measure at single instants.

A model yields at most one measurement per state, because no rate exceeds the tick rate. Sensors
that measure over an interval (an IMU sample, a LiDAR block) have their own timing.
"""

from typing import NamedTuple

from groundlink.core.clock import Schedule


class Event(NamedTuple):
    """One event of a schedule."""

    number: int
    nanos: int
    """Sim time of the event."""

    tick: int
    """First tick at or after the event. The event is measured with the state of this tick."""


class NextEvent:
    """Iterator over the events of a schedule, advanced tick by tick."""

    def __init__(self, schedule: Schedule) -> None:
        self._schedule = schedule
        self.restart()

    def restart(self) -> None:
        """Forget earlier ticks; the next event is the first at or after the next tick."""
        self.tick = -1
        """Last tick taken; -1 before the first. All events up to this tick were returned or
        skipped."""

        self._next: Event | None = None

    def by(self, tick: int) -> Event | None:
        """Take the next tick; return the event that its state completes, if any."""
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
