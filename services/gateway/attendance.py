# SPDX-License-Identifier: Apache-2.0
"""Which readings were due and never came to the gateway: by calendar, whoever lost them.

Rule: what is due and was not forwarded is counted once, by topic. Why it did not come the gateway
does not know: the sensor's own counters tell what it did not make; the rest was lost on the bus,
as while this process was cut off.
"""

from __future__ import annotations

from collections import Counter

from groundlink.calendars import calendar
from groundlink.scenario import Scenario
from groundlink.topics import sensor_outputs

COUNTER_PREFIX = "not_come_"
"""Of the counters, before the topic in ROS."""


class Attendance:
    """Looks for readings that are left out between those that came."""

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
        self._next: dict[str, int] = {}
        self._since_clock: Counter[str] = Counter()
        self._not_come: Counter[str] = Counter()

    def came(self, key: str, nanos: int) -> None:
        """Take note of a message with this sim time; what is no reading is passed over."""
        if key not in self._due:
            return
        topic, due = self._due[key]
        reading = due.at_or_after(nanos)
        self._since_clock[topic] += max(reading - self._next.get(key, reading), 0)
        self._next[key] = reading + 1

    def clock(self, *, has_begun: bool) -> None:
        """Take note of a clock message: what came since the last one was of its life, or not."""
        if has_begun:
            # A first reading may come before the clock that tells of its life.
            self._next.clear()
        else:
            self._not_come += self._since_clock
        self._since_clock.clear()

    def counters(self) -> dict[str, int]:
        """Return how many did not come, by topic."""
        return {COUNTER_PREFIX + topic: count for topic, count in self._not_come.items()}
