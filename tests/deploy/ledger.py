# SPDX-License-Identifier: Apache-2.0
"""Holds sensors to account on the bus: every reading that is due is seen there, or told missing."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Iterable
from types import TracebackType
from typing import Any

from groundlink import process
from groundlink.bus import Bus
from groundlink.calendars import Calendar, calendar
from groundlink.gaps import Gaps
from groundlink.messages import Clock, Message, decode, measured_nanos
from groundlink.topics import CLOCK, GAPS, sensor_outputs
from tests.system.rig import wait_for

SETTLED_SECONDS = 10.0
"""How long is waited for what is missing to be told: it takes less than one where nothing is."""


class _Sensor:
    def __init__(self, due: Calendar) -> None:
        self.due = due
        self.seen: set[int] = set()
        self.told: dict[int, str] = {}


class Ledger:
    """Readings and gaps of a run that the machine of the tests sees on the bus.

    It is an inbox that keeps stamps alone.
    """

    def __init__(self, endpoint: str) -> None:
        self._bus = Bus(connect=endpoint)
        run, scenario = process.join(self._bus, None, threading.Event())
        self._epoch_nanos: int | None = None
        self._sensors: dict[str, _Sensor] = {}
        self._sensor_of: dict[str, _Sensor] = {}
        inbox: Any = self
        for vehicle in scenario.vehicles:
            for spec in vehicle.sensors:
                name = f"{vehicle.name}/{spec.name}"
                sensor = self._sensors[name] = _Sensor(calendar(spec))
                row = next(output.row for output in sensor_outputs(spec) if not output.name)
                key = row.key_in(run, vehicle=vehicle.name, sensor=spec.name)
                self._sensor_of[key] = sensor
                self._bus.subscribe(key, row.message, inbox)
        self._bus.subscribe(GAPS.key_in(run), Gaps, inbox)
        self._bus.subscribe(CLOCK.key_in(run), Clock, inbox)

    def __enter__(self) -> Ledger:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._bus.close()

    def put(self, key: str, payload: bytes, message_type: type[Message]) -> None:
        """Take a message of the bus."""
        message = decode(payload, message_type)
        if isinstance(message, Clock):
            self._epoch_nanos = message.epoch_nanos
        elif self._epoch_nanos is None:
            return
        elif isinstance(message, Gaps):
            sensor = self._sensors[message.sensor]
            for gap in message.gaps:
                if "" in gap.outputs:
                    first = sensor.due.at_or_after(gap.first_nanos - self._epoch_nanos)
                    sensor.told |= dict.fromkeys(range(first, first + gap.readings), gap.cause)
        else:
            sensor = self._sensor_of[key]
            number = sensor.due.at_or_after(measured_nanos(message) - self._epoch_nanos)
            sensor.seen.add(number)

    def hears(self, names: Iterable[str]) -> None:
        """Return once readings of these sensors come."""
        wait_for(lambda: all(self._sensors[n].seen for n in names), 20, f"readings of {names}")

    def told(self, name: str) -> int:
        """Return how many readings of a sensor were told missing so far, for whatever cause."""
        return len(self._sensors[name].told)

    def missing(self, name: str) -> dict[str, int]:
        """Return by cause how many readings of a sensor are missing, each of which was told.

        From the first reading that was seen to the last one. Fail where one is neither seen nor,
        soon, told.
        """
        sensor = self._sensors[name]
        seen = sensor.seen.copy()
        due = range(min(seen), max(seen) + 1)

        def unexplained() -> list[int]:
            return [n for n in due if n not in sensor.seen and n not in sensor.told]

        deadline = time.monotonic() + SETTLED_SECONDS
        while unexplained() and time.monotonic() < deadline:
            time.sleep(0.1)
        assert not unexplained(), (
            f"{name}: of {len(due)} readings nobody explains {_ranges(unexplained())}; "
            f"told are {Counter(sensor.told.values())}"
        )
        return Counter(sensor.told[n] for n in due if n not in sensor.seen)


def _ranges(numbers: list[int]) -> str:
    """Return numbers as text, those that follow one another as from..to."""
    parts: list[list[int]] = []
    for n in numbers:
        if parts and n == parts[-1][-1] + 1:
            parts[-1][1:] = [n]
        else:
            parts.append([n])
    return ", ".join("..".join(map(str, part)) for part in parts)
