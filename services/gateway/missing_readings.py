# SPDX-License-Identifier: Apache-2.0
"""Which readings were due and never came to the gateway: by calendar, whoever lost them.

Rule: what is due and was not forwarded is counted once, by topic, from the first reading that came
to this gateway or its predecessors, through all lives of the run: to the last clock of one and from
the first reading of the next. What is left out is seen by what comes after it, or when its life is
over. Why it did not come the gateway does not know: the sensor's own counters tell what it did not
make; the rest was lost on the bus, as while this process was cut off.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Mapping

from groundlink.bus.topics import sensor_outputs
from groundlink.messages.base import Clock
from groundlink.messages.reading_schedule import calendar
from groundlink.scenario import Scenario

COUNTER_PREFIX = "not_come_"
"""Of the counters, before the topic in ROS."""

AHEAD_NANOS = 100_000_000
"""A reading may be this much ahead of its clock; what is more so is of another life."""

WAITING = 8192
"""Readings that may wait for their clock: some seconds of all streams together."""


class _Life:
    """What is due in one life of physics."""

    def __init__(self, clock: Clock) -> None:
        self.number, self.epoch_nanos = clock.life, clock.epoch_nanos
        self.clock_nanos = 0
        self.next: dict[str, int] = {}
        """By stream: the reading after the last that came; those of no stream yet are not due."""

    def take_clock(self, clock: Clock) -> None:
        self.clock_nanos = clock.stamp_nanos - clock.epoch_nanos

    def has(self, stamp_nanos: int) -> bool:
        """Return whether a stamp is of this life."""
        return 0 <= stamp_nanos - self.epoch_nanos <= self.clock_nanos + AHEAD_NANOS


class MissingReadingCounter:
    """Looks for readings that are left out."""

    def __init__(self, scenario: Scenario, run: str) -> None:
        self._due = {
            output.row.key_in(run, vehicle=vehicle.name, sensor=spec.name): (
                output.ros_topic,
                calendar(spec),
            )
            for vehicle in scenario.vehicles
            for spec in vehicle.sensors
            for output in sensor_outputs(spec)
        }
        self._waiting: deque[tuple[str, int]] = deque(maxlen=WAITING)
        self._life: _Life | None = None
        self._ended: _Life | None = None
        self._not_come: Counter[str] = Counter()

    def came(self, key: str, stamp_nanos: int) -> None:
        """Take note of a message measured at this instant; what is no reading is passed over."""
        if key in self._due:
            self._waiting.append((key, stamp_nanos))

    def clock(self, clock: Clock) -> None:
        """Take note of a clock message, by which those that came before are of its life, or not."""
        if self._life is not None and clock.life == self._life.number:
            self._life.take_clock(clock)
            self._settle()
            return
        self._ended, self._life = self._life, _Life(clock)
        self._life.take_clock(clock)
        if self._ended is not None:
            # The first of the new life may have come before its clock.
            for key, stamp_nanos in self._left_waiting(self._life):
                self._take(self._ended, key, stamp_nanos)
            self._end(self._ended)
            self._life.next = {key: self._due[key][1].first for key in self._ended.next}

    def counters(self) -> dict[str, int]:
        """Return how many did not come, by topic."""
        return {COUNTER_PREFIX + topic: count for topic, count in self._not_come.items() if count}

    def memory(self) -> tuple[dict[str, int], dict[str, int]]:
        """Return what a successor has to know: the next reading of each stream, and the counts."""
        self._settle()
        return (self._life.next if self._life is not None else {}), self._not_come

    def remember(self, next_of: Mapping[str, int], not_come: Mapping[str, int]) -> None:
        """Go on, in a life whose first clock was heard, from a predecessor's memory."""
        assert self._life is not None
        self._life.next = {key: reading for key, reading in next_of.items() if key in self._due}
        self._not_come = Counter(not_come)

    def _left_waiting(self, life: _Life) -> list[tuple[str, int]]:
        """Leave those waiting that are of a life; return the others."""
        waiting = [*self._waiting]
        self._waiting.clear()
        self._waiting.extend(one for one in waiting if life.has(one[1]))
        return [one for one in waiting if not life.has(one[1])]

    def _settle(self) -> None:
        """Take what waits and is of this life or the one before; leave what is ahead of both."""
        if (life := self._life) is None:
            return
        ahead = []
        while self._waiting:
            key, stamp_nanos = self._waiting.popleft()
            if life.has(stamp_nanos):
                self._take(life, key, stamp_nanos)
            elif self._ended is not None and self._ended.has(stamp_nanos):
                self._take_late(self._ended, key, stamp_nanos)
            elif stamp_nanos > life.epoch_nanos:
                ahead.append((key, stamp_nanos))
        self._waiting.extend(ahead)

    def _take(self, life: _Life, key: str, stamp_nanos: int) -> None:
        topic, due = self._due[key]
        reading = due.at_or_after(stamp_nanos - life.epoch_nanos)
        self._not_come[topic] += max(reading - life.next.get(key, reading), 0)
        life.next[key] = max(life.next.get(key, 0), reading + 1)

    def _end(self, life: _Life) -> None:
        """Count what did not come of a life that is over.

        The newest reading of each stream may have been under way as it ended.
        """
        for key, reading in life.next.items():
            topic, due = self._due[key]
            self._not_come[topic] += max(due.at_or_after(life.clock_nanos + 1) - 1 - reading, 0)

    def _take_late(self, life: _Life, key: str, stamp_nanos: int) -> None:
        """Take one of a life that is over: it is counted as one that did not come."""
        topic, due = self._due[key]
        reading = due.at_or_after(stamp_nanos - life.epoch_nanos)
        last = due.at_or_after(life.clock_nanos + 1) - 2
        if life.next.get(key, last + 1) <= reading <= last:
            self._not_come[topic] -= 1
            life.next[key] = reading + 1
