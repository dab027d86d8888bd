# SPDX-License-Identifier: Apache-2.0
"""Missing readings: counts the readings that were due by their schedule and never arrived.

Each is counted once, by topic, from the first reading that arrived at this gateway or a
predecessor, in all episodes of the run. A gap is seen when a later reading arrives or the episode
ends. The cause is not known here: counters of the sensor tell what it did not publish; the bus has
lost the rest, for example while this process was disconnected.
"""

from collections import Counter, deque
from collections.abc import Mapping

from groundlink.bus.topics import sensor_outputs
from groundlink.messages.base import Clock
from groundlink.scenario import Scenario

COUNTER_PREFIX = "not_come_"
"""Prefix of the counters, before the topic in ROS."""

AHEAD_NANOS = 100_000_000
"""A reading may be this much ahead of its clock; beyond it, it is of another episode."""

WAITING = 8192
"""Readings that may wait for their clock: some seconds of all streams together."""


class _Episode:
    """Readings that are due in one episode."""

    def __init__(self, clock: Clock) -> None:
        self.number, self.epoch_nanos = clock.episode, clock.epoch_nanos
        self.clock_nanos = 0
        self.next: dict[str, int] = {}
        """By stream: number of the reading after the last one; streams without any are not due."""

    def take_clock(self, clock: Clock) -> None:
        self.clock_nanos = clock.stamp_nanos - clock.epoch_nanos

    def has(self, stamp_nanos: int) -> bool:
        """Return whether a stamp is of this episode."""
        return 0 <= stamp_nanos - self.epoch_nanos <= self.clock_nanos + AHEAD_NANOS


class MissingReadingCounter:
    """Counts missing readings by topic."""

    def __init__(self, scenario: Scenario, run: str) -> None:
        self._due = {
            output.row.key_in(run, vehicle=vehicle.name, sensor=spec.name): (
                output.ros_topic,
                spec.schedule(),
            )
            for vehicle in scenario.vehicles
            for spec in vehicle.sensors
            for output in sensor_outputs(spec)
        }
        self._waiting: deque[tuple[str, int]] = deque(maxlen=WAITING)
        self._episode: _Episode | None = None
        self._ended: _Episode | None = None
        self._not_come: Counter[str] = Counter()

    def came(self, key: str, stamp_nanos: int) -> None:
        """Record a message measured at this instant; ignore it if it is not a reading."""
        if key in self._due:
            self._waiting.append((key, stamp_nanos))

    def clock(self, clock: Clock) -> None:
        """Record a clock message and assign the readings that arrived before it to an episode."""
        if self._episode is not None and clock.episode == self._episode.number:
            self._episode.take_clock(clock)
            self._settle()
            return
        self._ended, self._episode = self._episode, _Episode(clock)
        self._episode.take_clock(clock)
        if self._ended is not None:
            # The first readings of the new episode may have arrived before its clock.
            for key, stamp_nanos in self._left_waiting(self._episode):
                self._take(self._ended, key, stamp_nanos)
            self._end(self._ended)
            self._episode.next = {key: self._due[key][1].first for key in self._ended.next}

    def counters(self) -> dict[str, int]:
        """Return the number of missing readings, by topic."""
        return {COUNTER_PREFIX + topic: count for topic, count in self._not_come.items() if count}

    def memory(self) -> tuple[dict[str, int], dict[str, int]]:
        """Return what a successor needs: the next reading of each stream, and the counts."""
        self._settle()
        return (self._episode.next if self._episode is not None else {}), self._not_come

    def remember(self, next_of: Mapping[str, int], not_come: Mapping[str, int]) -> None:
        """Continue from a predecessor's memory, after the first clock of an episode."""
        assert self._episode is not None
        self._episode.next = {key: reading for key, reading in next_of.items() if key in self._due}
        self._not_come = Counter(not_come)

    def _left_waiting(self, episode: _Episode) -> list[tuple[str, int]]:
        """Keep the waiting readings of an episode; return the others."""
        waiting = [*self._waiting]
        self._waiting.clear()
        self._waiting.extend(one for one in waiting if episode.has(one[1]))
        return [one for one in waiting if not episode.has(one[1])]

    def _settle(self) -> None:
        """Take waiting readings of this episode or the one before; keep those that are ahead."""
        if (episode := self._episode) is None:
            return
        ahead = []
        while self._waiting:
            key, stamp_nanos = self._waiting.popleft()
            if episode.has(stamp_nanos):
                self._take(episode, key, stamp_nanos)
            elif self._ended is not None and self._ended.has(stamp_nanos):
                self._take_late(self._ended, key, stamp_nanos)
            elif stamp_nanos > episode.epoch_nanos:
                ahead.append((key, stamp_nanos))
        self._waiting.extend(ahead)

    def _take(self, episode: _Episode, key: str, stamp_nanos: int) -> None:
        topic, due = self._due[key]
        reading = due.at_or_after(stamp_nanos - episode.epoch_nanos)
        self._not_come[topic] += max(reading - episode.next.get(key, reading), 0)
        episode.next[key] = max(episode.next.get(key, 0), reading + 1)

    def _end(self, episode: _Episode) -> None:
        """Count the missing readings at the end of an episode.

        The newest reading of each stream may have been in flight.
        """
        for key, reading in episode.next.items():
            topic, due = self._due[key]
            self._not_come[topic] += max(due.at_or_after(episode.clock_nanos + 1) - 1 - reading, 0)

    def _take_late(self, episode: _Episode, key: str, stamp_nanos: int) -> None:
        """Take a reading of an ended episode, which was counted as missing."""
        topic, due = self._due[key]
        reading = due.at_or_after(stamp_nanos - episode.epoch_nanos)
        last = due.at_or_after(episode.clock_nanos + 1) - 2
        if episode.next.get(key, last + 1) <= reading <= last:
            self._not_come[topic] -= 1
            episode.next[key] = reading + 1
