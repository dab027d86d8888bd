# SPDX-License-Identifier: Apache-2.0
"""Holds sensors to account on the bus: every reading that is due is seen there, or told missing."""

from __future__ import annotations

import threading
import time
from types import TracebackType
from typing import Any

from groundlink import process
from groundlink.bus import Bus
from groundlink.calendars import Calendar, calendar
from groundlink.gaps import Gaps
from groundlink.messages import Clock, Message, decode, measured_nanos
from groundlink.topics import CLOCK, GAPS, sensor_outputs
from tests.system.rig import wait_for

SETTLED_SECONDS = 1.0
"""What is missing is told within so long, eight times a window."""


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

    def hears(self, name: str) -> None:
        """Return once readings of a sensor come."""
        wait_for(lambda: self._sensors[name].seen, 10, f"readings of {name}")

    def missing(self, name: str) -> tuple[dict[str, int], list[int]]:
        """Return how many readings of a sensor were told missing, by cause, and which nobody told.

        From the first reading that was seen to the last one.
        """
        sensor = self._sensors[name]
        last = max(sensor.seen)
        time.sleep(SETTLED_SECONDS)
        due = range(min(sensor.seen), last + 1)
        told: dict[str, int] = {}
        for number in due:
            if number not in sensor.seen and (cause := sensor.told.get(number)):
                told[cause] = told.get(cause, 0) + 1
        return told, [n for n in due if n not in sensor.seen and n not in sensor.told]
