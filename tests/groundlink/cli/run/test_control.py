# SPDX-License-Identifier: Apache-2.0
"""Stalled steps: each stalling process is named once."""

from typing import Any

from groundlink.cli.run.control import StallReporter
from groundlink.messages.base import Health, encode
from groundlink.messages.stalls import Stalls


class Bus:
    """A bus on which physics says who is silent."""

    def subscribe(self, key: str, message: type[Health], inbox: Any) -> None:
        self._inbox, self._key = inbox, key

    def silent(self, *names: str) -> None:
        counters = Stalls(silent_now=names).counters()
        self._inbox.put(self._key, encode(Health("physics", 1, 12, counters)), Health)


def test_who_holds_up_steps_is_said_once() -> None:
    bus: Any = Bus()
    waits = StallReporter(bus, "lab")
    assert waits.line(12) == ""
    bus.silent("rover/lidar")
    assert waits.line(12) == "run `lab`: waiting at tick 12 for rover/lidar"
    bus.silent("rover/lidar")
    assert waits.line(12) == ""
    bus.silent("rover/lidar", "rover/imu")
    assert waits.line(12) == "run `lab`: waiting at tick 12 for rover/lidar, rover/imu"
    bus.silent()
    assert waits.line(13) == ""
