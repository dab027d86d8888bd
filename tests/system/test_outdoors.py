# SPDX-License-Identifier: Apache-2.0
"""System tests of GNSS receivers and range finders: on the bus, in ROS and as NMEA."""

import math
import re
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from functools import reduce
from operator import xor
from pathlib import Path

import pytest

from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.bus.topics import SENSOR_TOPICS
from groundlink.messages.base import encode
from groundlink.messages.imagery import Range
from groundlink.messages.navigation import NavSatFix

from .rig import REPOSITORY, Rig, rig, wait_for

pytestmark = pytest.mark.system

YARD = REPOSITORY / "scenarios" / "yard.yaml"

FAST = "time: {mode: fast, epoch: zero, window_ticks: 200}\n"

FACING_THE_WALL = "placement: {x_m: -12.0, y_m: -4.0, yaw_deg: 180.0}"
"""The front mount is 1.35 m away from it."""


@pytest.fixture
def outdoors(tmp_path: Path) -> Iterator[Rig]:
    with yard(tmp_path) as it:
        yield it


@contextmanager
def yard(folder: Path) -> Iterator[Rig]:
    """Start physics with the yard's receiver and its two range finders."""
    with rig(folder, time_section=FAST) as it:
        own = it.scenario.read_text(encoding="utf-8")
        gateway = own[own.index("\ngateway:") :]
        text = YARD.read_text(encoding="utf-8")
        placed = "placement: {x_m: -8.0, y_m: -4.0, yaw_deg: 0.0}"
        assert placed in text
        text = text.replace(placed, FACING_THE_WALL).partition("    # Under the roof")[0]
        # In fast mode physics waits for every sensor of the scenario.
        wanted = [f"name: {name}," for name in ("gnss", "sonar", "tof")]
        lines = [
            line
            for line in text.splitlines()
            if "- {kind: " not in line or any(name in line for name in wanted)
        ]
        it.scenario.write_text("\n".join(lines) + gateway, encoding="utf-8")
        physics = ("-m", "services.physics", str(it.scenario), "--listen", it.endpoint)
        it.start(*physics, log="physics.log")
        wait_for(it.is_answered, 20, "physics listens")
        yield it


def sensor(it: Rig, kind: str, name: str, *more: str) -> None:
    command = ("-m", f"services.sensors.{kind}", "--name", f"rover/{name}")
    it.start(*command, "--connect", it.endpoint, *more, log=f"{name}.log")


def taken(inbox: BusInbox[NavSatFix], count: int) -> list[NavSatFix]:
    """Return the next messages."""
    messages: list[NavSatFix] = []
    while len(messages) < count:
        arrived = inbox.get(seconds=60)
        assert arrived, "the receiver fell silent"
        messages.append(arrived[1])
    return messages


def test_fixes_sentences_and_distances_come_from_real_processes(outdoors: Rig) -> None:
    it = outdoors
    with Bus(connect=it.endpoint) as bus, socket.socket(type=socket.SOCK_DGRAM) as device:
        device.bind(("127.0.0.1", 0))
        device.settimeout(60)
        fixes: BusInbox[NavSatFix] = BusInbox(depth=10_000)
        distances: dict[str, BusInbox[Range]] = {}
        bus.subscribe(
            SENSOR_TOPICS["gnss"].key_in("yard", vehicle="rover", sensor="gnss"), NavSatFix, fixes
        )
        for name in ("sonar", "tof"):
            distances[name] = BusInbox(depth=10_000)
            key = SENSOR_TOPICS["range"].key_in("yard", vehicle="rover", sensor=name)
            bus.subscribe(key, Range, distances[name])
        it.start("-m", "services.gateway", "--connect", it.endpoint, log="gateway.log")
        receiver = ("-m", "udp_bridge", "listen", "--bind", it.address(it.peer), "--json")
        it.start(*receiver, log="received.jsonl")
        sensor(it, "gnss", "gnss", "--native", f"127.0.0.1:{device.getsockname()[1]}")
        sensor(it, "range", "sonar")
        sensor(it, "range", "tof")

        # 10 Hz from the start, the first two seconds without a fix; then centimeters.
        first = taken(fixes, 40)
        assert [fix.stamp_nanos for fix in first] == [i * 100_000_000 for i in range(40)]
        assert [fix.status for fix in first] == [-1] * 20 + [2] * 20
        for fix in first[20:]:
            # x = -12 m, y = -4 m from the world's datum; a degree is 111.27 km of latitude there.
            assert fix.latitude_deg == pytest.approx(52.254 - 4.0 / 111_270, abs=6e-7)
            assert fix.longitude_deg == pytest.approx(20.9 - 12.0 / 68_270, abs=1e-6)
        for inbox in distances.values():
            arrived = inbox.get(seconds=60)
            assert arrived
            assert math.isclose(arrived[1].range_m, 1.35, abs_tol=0.1)

        # Sentences of the same instants, in the same order.
        lines = [device.recv(2000) for _ in range(3 * len(first))]
        for line in lines:
            found = re.fullmatch(rb"\$(.*)\*([0-9A-F]{2})\r\n", line)
            assert found
            assert reduce(xor, found[1]) == int(found[2], 16)
        ggas = [line.decode().split(",") for line in lines[::3]]
        for fix, gga in zip(first, ggas, strict=True):
            assert gga[0] == "$GPGGA"
            assert gga[6] == ("0" if fix.status < 0 else "4")
            assert float(gga[1]) == pytest.approx(fix.stamp_nanos / 1e9, abs=0.006)
            if fix.status >= 0:
                read = int(gga[2][:2]) + float(gga[2][2:]) / 60
                assert read == pytest.approx(fix.latitude_deg, abs=1e-9)

        for topic in ("/gnss/fix", "/sonar", "/tof"):
            wait_for(lambda t=topic: f'"{t}"' in it.log("received.jsonl"), 30, f"{topic} arrives")


def fixes_until(it: Rig, last_nanos: int, *, crash: bool) -> list[bytes]:
    """Return the fixes of a run as they were on the bus, each once."""
    with Bus(connect=it.endpoint) as bus:
        inbox: BusInbox[NavSatFix] = BusInbox(depth=10_000)
        bus.subscribe(
            SENSOR_TOPICS["gnss"].key_in("yard", vehicle="rover", sensor="gnss"), NavSatFix, inbox
        )
        for name in ("sonar", "tof"):
            sensor(it, "range", name)
        sensor(it, "gnss", "gnss")
        first, stamp_nanos, found = it.started[-1], -1, []
        while stamp_nanos < last_nanos:
            (fix,) = taken(inbox, 1)
            if fix.stamp_nanos > stamp_nanos:  # A successor repeats what was not acknowledged.
                stamp_nanos = fix.stamp_nanos
                found.append(encode(fix))
            if crash and stamp_nanos > last_nanos // 3:
                first.kill()
                first.wait()
                sensor(it, "gnss", "gnss")
                crash = False
        return found


def test_a_killed_receiver_changes_no_byte_though_fixes_were_under_way(tmp_path: Path) -> None:
    runs = []
    for crash in (False, True):
        (folder := tmp_path / str(crash)).mkdir()
        with yard(folder) as it:
            runs.append(fixes_until(it, 6_000_000_000, crash=crash))
    assert len(runs[0]) == 61
    assert runs[0] == runs[1]


def test_unreachable_native_address_gives_one_line(outdoors: Rig) -> None:
    sensor(outdoors, "gnss", "gnss", "--native", "nowhere")
    process = outdoors.started[-1]
    assert process.wait(20) == 2
    assert outdoors.log("gnss.log").count("\n") == 1
    assert "nowhere" in outdoors.log("gnss.log")
