# SPDX-License-Identifier: Apache-2.0
"""Commands follow what a person does at a device, at a limited rate, and end with a stop."""

import os
import struct
import threading
import time
from functools import partial
from typing import Any

import pytest

from groundlink.cli.run import drive as module
from groundlink.cli.terminal.joystick import Joystick
from groundlink.cli.terminal.keyboard import Keyboard
from groundlink.core.errors import UserError
from groundlink.loader import load
from groundlink.messages.base import Clock, Command, encode
from tests.system.rig import wait_for

STAMP = 7_000_000_000


class ClockedBus:
    """Has one clock message, and keeps what is published."""

    def __init__(self) -> None:
        self.published: list[Command] = []

    def subscribe(self, key: str, message_type: type[Clock], inbox: Any) -> None:
        inbox.put(key, encode(Clock(STAMP, 0, 0, 0)), message_type)

    def publisher(self, key: str, delivery: Any) -> Any:
        assert key == "groundlink/lab/rover/command"
        return self.published.append


def driven(device: Joystick | Keyboard, data: list[bytes], apart_s: float) -> list[Command]:
    """Return the commands while a device sends bytes, until its end.

    Without a time between them, bytes wait until those before them have given a command.
    """
    bus = ClockedBus()
    reading, writing = os.pipe()

    def has_commanded(most_before: int) -> bool:
        return len(bus.published) > most_before

    def send() -> None:
        for i, part in enumerate(data):
            if apart_s:
                time.sleep(apart_s)
            elif i:
                # The first command from now on may be of the time before the last bytes.
                wait_for(partial(has_commanded, len(bus.published) + 1), 10, "a command")
            os.write(writing, part)
        os.close(writing)

    (rover,) = load("indoor_lab").vehicles
    sender = threading.Thread(target=send)
    sender.start()
    bus_as_any: Any = bus
    module._drive_live(bus_as_any, "lab", rover, device, reading, threading.Event())
    sender.join()
    os.close(reading)
    return bus.published


def test_stick_commands_and_the_end_stops() -> None:
    held, ahead = struct.pack("=IhBB", 0, 1, 1, 4), struct.pack("=IhBB", 0, -32767, 2, 1)
    moves = [struct.pack("=IhBB", i, -32767 + i, 2, 1) for i in range(100)]
    commands = driven(Joystick(max_mps=1.0), [held, ahead, *moves], 0.002)
    *_, last, stop = commands
    assert last.stamp_nanos == STAMP
    assert last.linear_mps == pytest.approx((0.5, 0.0, 0.0), abs=0.01)
    assert stop.linear_mps == stop.angular_radps == (0.0, 0.0, 0.0)
    assert 3 <= len(commands) < 40, "102 events need not cause as many commands"


def test_q_ends_and_stops() -> None:
    commands = driven(Keyboard(max_mps=1.0), [b"w", b"wq"], 0)
    assert commands[-2].linear_mps == (0.5, 0.0, 0.0)
    assert commands[-1].linear_mps == (0.0, 0.0, 0.0)


def test_device_that_is_gone_stops_the_vehicle() -> None:
    bus: Any = ClockedBus()
    with pytest.raises(UserError, match="joystick was removed"):
        module._read(1 << 20)
    (rover,) = load("indoor_lab").vehicles
    reading, writing = os.pipe()
    os.close(writing)
    module._drive_live(bus, "lab", rover, Joystick(max_mps=1.0), reading, threading.Event())
    os.close(reading)
    assert bus.published[-1].linear_mps == (0.0, 0.0, 0.0)


def test_missing_joystick_is_one_line() -> None:
    with (
        pytest.raises(
            UserError, match=r"^--joystick /nowhere/js0: no such file or directory\. Fix"
        ),
        module._joystick("/nowhere/js0"),
    ):
        pass
