# SPDX-License-Identifier: Apache-2.0
"""Audit of readings on the bus: each is received, reported missing, or counted as lost.

A due reading must appear on the bus, or its sensor must report it as missing with a cause.
Otherwise it was lost on the bus, and the gateway's counters must include it. The audit covers all
episodes of the run. An episode ends with its last clock message, and in the next episode readings
are due from the first one on. Open a ledger before a fault and read it afterwards.
"""

import threading
import time
from collections import Counter
from collections.abc import Iterable
from itertools import pairwise
from typing import Any, NamedTuple

from groundlink.bus.core_topics import CLOCK, GATEWAY, HEALTH
from groundlink.bus.session import Bus
from groundlink.bus.topics import MISSING_READINGS, sensor_outputs
from groundlink.core.clock import NANOS
from groundlink.messages.base import BusMessage, Clock, Health, decode, measured_nanos
from groundlink.messages.missing_readings import MissingReadings, MissingSpan
from groundlink.messages.reading_schedule import ReadingSchedule
from groundlink.process.joining import join
from services.gateway.missing_readings import COUNTER_PREFIX
from tests.system.rig import wait_for

TOLD_SECONDS = 3.0
"""A sensor tells what is missing after a later reading, with its next acknowledgement. What is not
told in this time was lost on the bus."""

SETTLED_SECONDS = 10.0
"""How long is waited for the gateway's count of what was lost."""

LOST = "lost on the bus"

UNDER_WAY_SECONDS = 0.25
"""Of readings that were in a router when it ended may have come to the gateway and not here."""

SILENT_SECONDS = 0.5
"""A clock that stays out for so long says that router or physics was away."""

NEVER = 1 << 63
"""An instant after all others."""


class _Sensor:
    def __init__(self, due: ReadingSchedule, topic: str) -> None:
        self.due, self.counter = due, COUNTER_PREFIX + topic
        self.seen: set[int] = set()
        """Instants of measurement."""

        self.told: set[MissingSpan] = set()
        """What is told again is the same."""


class _Due(NamedTuple):
    """Readings of one sensor in one episode of the run, by their numbers there."""

    numbers: range
    seen: set[int]
    told: dict[int, str]

    def unseen(self) -> list[int]:
        return [n for n in self.numbers if n not in self.seen]

    def lost(self) -> list[int]:
        return [n for n in self.unseen() if n not in self.told]


class Ledger:
    """Readings, gaps and counts of a run that the machine of the tests sees on the bus.

    It is an inbox that keeps stamps alone.
    """

    def __init__(self, endpoint: str) -> None:
        self._bus = Bus(connect=endpoint)
        run, scenario = join(self._bus, None, threading.Event())
        self._clock_nanos: dict[int, int] = {}
        """By the epoch of each episode: the stamp of its last clock."""

        self._clock_seconds = 0.0
        self._was_silent = False
        self._counted: Counter[str] | None = None
        self._counted_before: Counter[str] = Counter()
        self._sensors: dict[str, _Sensor] = {}
        self._sensor_of: dict[str, _Sensor] = {}
        inbox: Any = self
        for vehicle in scenario.vehicles:
            for spec in vehicle.sensors:
                name = f"{vehicle.name}/{spec.name}"
                main = next(output for output in sensor_outputs(spec) if not output.name)
                sensor = self._sensors[name] = _Sensor(spec.schedule(), main.ros_topic)
                key = main.row.key_in(run, vehicle=vehicle.name, sensor=spec.name)
                self._sensor_of[key] = sensor
                self._bus.subscribe(key, main.row.message, inbox)
        self._bus.subscribe(MISSING_READINGS.key_in(run), MissingReadings, inbox)
        self._bus.subscribe(CLOCK.key_in(run), Clock, inbox)
        self._bus.subscribe(HEALTH.key_in(run, process=GATEWAY), Health, inbox)

    def __enter__(self) -> "Ledger":
        return self

    def __exit__(self, *_: object) -> None:
        self._bus.close()

    def put(self, key: str, payload: bytes, message_type: type[BusMessage]) -> None:
        """Take a message of the bus."""
        message = decode(payload, message_type)
        if isinstance(message, Health):
            if self._counted is None:
                self._counted_before = Counter(message.counters)
            self._counted = Counter(message.counters)
        elif isinstance(message, Clock):
            now = time.monotonic()
            self._was_silent |= 0 < self._clock_seconds < now - SILENT_SECONDS
            self._clock_seconds = now
            self._clock_nanos[message.epoch_nanos] = message.stamp_nanos
        elif self._counted is None:
            return  # what was missing so far is not told apart in the counters
        elif isinstance(message, MissingReadings):
            told = self._sensors[message.sensor].told
            told |= {gap for gap in message.gaps if "" in gap.outputs}
        else:
            self._sensor_of[key].seen.add(measured_nanos(message))

    def hears(self, names: Iterable[str]) -> None:
        """Return once readings of these sensors come."""
        wait_for(lambda: all(self._sensors[n].seen for n in names), 20, f"readings of {names}")

    def told(self, name: str) -> int:
        """Return how many readings of a sensor were told missing so far, for whatever cause."""
        return sum(gap.readings for gap in self._sensors[name].told.copy())

    def missing(self, name: str) -> dict[str, int]:
        """Return by cause how many readings of a sensor are missing, each told or counted.

        From the first reading that was seen to the last one. Fail where one is neither seen nor,
        soon, told or counted.
        """
        sensor = self._sensors[name]
        begun = time.monotonic()
        episodes = self._episodes(sensor)
        until = tuple(episode.numbers.stop for episode in episodes)
        while (
            any(episode.lost() for episode in episodes)
            and (waited := time.monotonic() - begun) < SETTLED_SECONDS
            and (waited < TOLD_SECONDS or not self._explains(sensor, episodes))
        ):
            time.sleep(0.1)
            episodes = self._episodes(sensor, until)
        lost = [_ranges(episode.lost()) for episode in episodes if episode.lost()]
        causes = Counter(
            episode.told.get(n, LOST) for episode in episodes for n in episode.unseen()
        )
        assert self._explains(sensor, episodes), (
            f"{name}: of {sum(len(episode.numbers) for episode in episodes)} readings nobody "
            f"explains {'; '.join(lost)}; missing are {dict(causes)}, and the gateway counts "
            f"{self._not_come(sensor)}"
        )
        return causes

    def _not_come(self, sensor: _Sensor) -> int:
        """Return how many the gateway has counted as such since this ledger was opened."""
        assert self._counted is not None
        return self._counted[sensor.counter] - self._counted_before[sensor.counter]

    def _explains(self, sensor: _Sensor, episodes: list[_Due]) -> bool:
        """Return whether what was lost is in the gateway's count of what did not come."""
        if not any(episode.lost() for episode in episodes):
            return True
        under_way = 0
        if self._was_silent:
            under_way = sensor.due.at_or_after(round(UNDER_WAY_SECONDS * NANOS))
        return (
            sum(len(episode.unseen()) for episode in episodes) <= self._not_come(sensor) + under_way
        )

    def _episodes(self, sensor: _Sensor, until: tuple[int, ...] = ()) -> list[_Due]:
        """Return what was due in each episode, as far as it goes, or first went in the last one."""
        epochs = sorted(self._clock_nanos)
        return [
            self._episode(sensor, epoch, after, i, until)
            for i, (epoch, after) in enumerate(pairwise([*epochs, NEVER]))
        ]

    def _episode(
        self, sensor: _Sensor, epoch: int, after: int, i: int, until: tuple[int, ...]
    ) -> _Due:
        def number(stamp_nanos: int) -> int:
            return sensor.due.at_or_after(stamp_nanos - epoch)

        seen = {number(stamp) for stamp in sensor.seen.copy() if epoch <= stamp < after}
        told: dict[int, str] = {}
        for gap in sensor.told.copy():
            if epoch <= gap.first_nanos < after:
                first = number(gap.first_nanos)
                told |= dict.fromkeys(range(first, first + gap.readings), gap.cause)
        begin = sensor.due.first if i else min(seen, default=0)
        end = max(seen, default=begin - 1) + 1
        if after != NEVER:
            # The newest may have been under way as it ended.
            end = max(end, number(self._clock_nanos[epoch] + 1) - 1)
        elif i < len(until):
            end = until[i]
        return _Due(range(begin, end), seen, told)


def _ranges(numbers: list[int]) -> str:
    """Return numbers as text, those that follow one another as from..to."""
    parts: list[list[int]] = []
    for n in numbers:
        if parts and n == parts[-1][-1] + 1:
            parts[-1][1:] = [n]
        else:
            parts.append([n])
    return ", ".join("..".join(map(str, part)) for part in parts)
