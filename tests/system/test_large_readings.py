# SPDX-License-Identifier: Apache-2.0
"""Large readings pass by shared memory, and by the router to those who ask there."""

import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from groundlink.bus.inbox import BusInbox
from groundlink.bus.local_inbox import LocalInbox
from groundlink.bus.session import Bus
from groundlink.messages.base import PointCloud

from .large_readings import reading
from .rig import REPOSITORY, free_port, wait_for

pytestmark = pytest.mark.system

RUN = "groundlink/test_large"
KEYS = (f"{RUN}/rover/lidar", f"{RUN}/rover/depth")


class Received:
    """What a subscriber has received: by key, the numbers of the readings in order."""

    def __init__(self, inbox: BusInbox[PointCloud]) -> None:
        self.inbox = inbox
        self.numbers: dict[str, list[int]] = {key: [] for key in KEYS}

    def update(self) -> None:
        while arrived := self.inbox.get(seconds=0.02):
            key, message = arrived
            number = message.stamp_nanos
            assert message == reading(number), "a reading is not whole"
            self.numbers[key].append(number)
            if len(self.numbers[key]) % 20 == 0:
                return

    def wait_for_more(self, *keys: str, readings: int = 20) -> None:
        wanted = {key: len(self.numbers[key]) + readings for key in keys}

        def have_come() -> bool:
            self.update()
            return all(len(self.numbers[key]) >= count for key, count in wanted.items())

        wait_for(have_come, 20, f"{readings} readings of {keys}")

    def has_begun_again(self, key: str) -> bool:
        """Return whether a reading of a successor has come; forget those before it."""
        self.update()
        numbers = self.numbers[key]
        for place in range(1, len(numbers)):
            if numbers[place] < numbers[place - 1]:
                del numbers[:place]
                return True
        return False

    def is_gapless(self, key: str) -> bool:
        numbers = self.numbers[key]
        return numbers == list(range(numbers[0], numbers[0] + len(numbers)))


def slots_of(pid: int | str = "self") -> set[str]:
    """Return the slots that a process has mapped, by inode."""
    maps = Path(f"/proc/{pid}/maps").read_text()
    return set(re.findall(r" (\d+) +/memfd:groundlink", maps))


Start = Callable[[str], subprocess.Popen[bytes]]


@pytest.fixture
def endpoint() -> Iterator[str]:
    address = f"tcp/127.0.0.1:{free_port()}"
    with Bus(listen=address):
        yield address


@pytest.fixture
def start(endpoint: str) -> Iterator[Start]:
    """Return a function that starts the sensor of a key."""
    with ExitStack() as stack:

        def one(key: str) -> subprocess.Popen[bytes]:
            command = [sys.executable, "-m", "tests.system.large_readings", endpoint, key]
            process = stack.enter_context(subprocess.Popen(command, cwd=REPOSITORY))
            stack.callback(process.kill)
            return process

        yield one


def test_two_sensors_a_late_recorder_and_a_killed_sensor(endpoint: str, start: Start) -> None:
    sensors = {key: start(key) for key in KEYS}
    with Bus(connect=endpoint) as gateway, Bus(connect=endpoint) as recorder:
        inbox: LocalInbox[PointCloud] = gateway.local_inbox(depth=1000)
        for key in KEYS:
            gateway.subscribe_local(key, PointCloud, inbox)
        live = Received(inbox)
        live.wait_for_more(*KEYS)
        wait_for(lambda: [live.update(), len(slots_of()) >= 2][1], 10, "slots are in use")

        late: BusInbox[PointCloud] = BusInbox(depth=1000)
        recorder.subscribe_in_order(f"{RUN}/**", lambda _: PointCloud, late)
        recorded = Received(late)
        for _ in range(2):
            live.wait_for_more(*KEYS)
            recorded.wait_for_more(*KEYS)
        assert all(live.is_gapless(key) and recorded.is_gapless(key) for key in KEYS)

        killed, other = KEYS
        slots_before = slots_of(sensors[killed].pid)
        assert slots_before & slots_of()
        os.kill(sensors[killed].pid, signal.SIGKILL)
        sensors[killed].wait()
        start(killed)
        for each in (live, recorded):
            wait_for(lambda each=each: each.has_begun_again(killed), 20, "the successor is there")
            each.wait_for_more(*KEYS)
            assert each.is_gapless(killed)
            assert each.is_gapless(other)
        wait_for(lambda: [live.update(), not slots_of() & slots_before][1], 10, "no slot stays")


def test_a_gateway_that_ends_leaves_no_slots_at_the_sensor(endpoint: str, start: Start) -> None:
    sensor = start(KEYS[0])
    with Bus(connect=endpoint) as gateway:
        inbox: LocalInbox[PointCloud] = gateway.local_inbox(depth=1000)
        gateway.subscribe_local(KEYS[0], PointCloud, inbox)
        live = Received(inbox)
        wait_for(lambda: [live.update(), slots_of(sensor.pid)][1], 20, "slots are in use")
    wait_for(lambda: not slots_of(sensor.pid), 10, "the sensor has no slots")
    assert sensor.poll() is None
