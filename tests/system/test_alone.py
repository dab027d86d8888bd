# SPDX-License-Identifier: Apache-2.0
"""Each process starts alone, as on a machine of its own; in fast mode the same bytes come out."""

from __future__ import annotations

import hashlib
import os
import signal
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from groundlink.bus import Bus
from groundlink.inbox import Inbox
from groundlink.messages import Imu, Message, PointCloud, WheelEncoders, encode
from groundlink.topics import ENCODERS, IMU, POINTS

from .rig import Rig, rig, wait_for

pytestmark = pytest.mark.system

SENSORS = {"lidar": (POINTS, PointCloud), "imu": (IMU, Imu), "encoders": (ENCODERS, WheelEncoders)}


def start_alone(it: Rig) -> None:
    """Start every process by hand: physics is the router, the others know only its endpoint."""
    it.start("-m", "services.physics", str(it.scenario), "--listen", it.endpoint, log="physics.log")
    for name in SENSORS:
        start_sensor(it, name)


def start_sensor(it: Rig, name: str) -> int:
    wait_for(lambda: is_answered(it), 20, "physics listens")
    command = ("-m", f"services.sensors.{name}", "--name", f"rover/{name}")
    return it.start(*command, "--connect", it.endpoint, log=f"{name}.log").pid


def is_answered(it: Rig) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", int(it.endpoint.rpartition(":")[2]))) == 0


def test_processes_start_alone_and_the_gateway_speaks_to_a_plain_receiver(tmp_path: Path) -> None:
    with rig(tmp_path) as it:
        start_alone(it)
        it.start("-m", "services.gateway", "--connect", it.endpoint, log="gateway.log")
        receiver = ("-m", "udp_bridge", "listen", "--bind", it.address(it.peer), "--json")
        it.start(*receiver, log="received.jsonl")
        for topic in ("/points", "/imu", "/wheel_encoders", "/clock", "/tf_static", "/cmd_vel"):
            wait_for(lambda t=topic: f'"{t}"' in it.log("received.jsonl"), 30, f"{topic} arrives")


FAST = "time: {mode: fast, epoch: zero, window_ticks: 200}\n"

UNTIL_NANOS = 3_000_000_000


class Witness:
    """Hashes every stream of a run up to three seconds of sim time."""

    def __init__(self, bus: Bus, run: str) -> None:
        self._inboxes: dict[str, Inbox[Message]] = {}
        for name, (topic, message_type) in SENSORS.items():
            inbox: Inbox[Message] = Inbox(depth=100_000)
            bus.subscribe(topic.key_in(run, vehicle="rover", sensor=name), message_type, inbox)
            self._inboxes[name] = inbox

    def digests(self) -> dict[str, tuple[int, str]]:
        """Return, by sensor, how many messages came and the hash over them, in order."""
        result = {}
        for name, inbox in self._inboxes.items():
            digest, stamps = hashlib.sha256(), []
            while not stamps or stamps[-1] < UNTIL_NANOS:
                arrived = inbox.get(seconds=60)
                assert arrived, f"{name} fell silent"
                stamp: int = arrived[1].stamp_nanos  # type: ignore[attr-defined]
                if stamps and stamp <= stamps[-1]:
                    continue  # a successor repeats what its predecessor had not acknowledged
                stamps.append(stamp)
                digest.update(encode(arrived[1]))
            result[name] = (len(stamps), digest.hexdigest())
        return result


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, tuple[int, str]]]:
    with rig(tmp_path_factory.mktemp("fast"), time_section=FAST) as it:
        it.start(
            *("-m", "services.physics", str(it.scenario), "--listen", it.endpoint),
            log="physics.log",
        )
        wait_for(lambda: is_answered(it), 20, "physics listens")
        with Bus(connect=it.endpoint) as bus:
            witness = Witness(bus, "indoor_lab")
            for name in SENSORS:
                start_sensor(it, name)
            yield witness.digests()


def test_every_stream_is_complete(undisturbed: dict[str, tuple[int, str]]) -> None:
    assert undisturbed["lidar"][0] == 31
    assert undisturbed["encoders"][0] == 151
    assert undisturbed["imu"][0] in (1199, 1200, 1201)


def test_a_killed_and_a_stopped_sensor_change_no_byte(
    tmp_path: Path, undisturbed: dict[str, tuple[int, str]]
) -> None:
    """In fast mode physics waits: start order, delays and a crash leave the same bytes."""
    with rig(tmp_path, time_section=FAST) as it:
        it.start(
            *("-m", "services.physics", str(it.scenario), "--listen", it.endpoint),
            log="physics.log",
        )
        wait_for(lambda: is_answered(it), 20, "physics listens")
        with Bus(connect=it.endpoint) as bus:
            witness = Witness(bus, "indoor_lab")
            progress: Inbox[Imu] = Inbox(depth=10)
            key = IMU.key_in("indoor_lab", vehicle="rover", sensor="imu")
            bus.subscribe(key, Imu, progress)
            pids = {name: start_sensor(it, name) for name in reversed(SENSORS)}
            wait_for(lambda: progress.get(seconds=1), 30, "the run has begun")
            os.kill(pids["imu"], signal.SIGSTOP)
            time.sleep(0.3)
            os.kill(pids["imu"], signal.SIGCONT)
            os.kill(pids["lidar"], signal.SIGKILL)
            time.sleep(0.3)
            start_sensor(it, "lidar")
            assert witness.digests() == undisturbed
