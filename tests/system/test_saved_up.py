# SPDX-License-Identifier: Apache-2.0
"""System tests of saving with `groundlink up` in real time: restore, and start from a file."""

import importlib.util
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest

from groundlink.bus.core_topics import COMMAND, BusTopic
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.bus.topics import SENSOR_TOPICS
from groundlink.core.clock import TICK_NANOS, TICK_RATE_HZ
from groundlink.episode.journal import loaded
from groundlink.messages.base import BusMessage, Command, M, decode, measured_nanos

from .rig import Observer, Rig, rig, wait_for

pytestmark = [pytest.mark.system, pytest.mark.timeout(300)]

HAS_ROS = importlib.util.find_spec("rclpy") is not None

COMPARED_NANOS = TICK_RATE_HZ * TICK_NANOS
"""How long a run goes on after the saved tick."""

STREAMS = {
    "lidar": SENSOR_TOPICS["lidar"],
    "imu": SENSOR_TOPICS["imu"],
    "encoders": SENSOR_TOPICS["encoders"],
}

Bodies = dict[int, bytes]
"""Of a stream, by the instant of measurement."""


class Stream(BusInbox[BusMessage]):
    """Keeps all that comes of a sensor."""

    def __init__(self, bus: Bus, run: str, sensor: str, row: BusTopic) -> None:
        super().__init__(depth=1)
        self.bodies: Bodies = {}
        bus.subscribe(row.key_in(run, vehicle="rover", sensor=sensor), row.message, self)

    def put(self, key: str, payload: bytes, message_type: type[M]) -> None:
        self.bodies[measured_nanos(decode(payload, message_type))] = payload

    def has_come_to(self, nanos: int) -> bool:
        return bool(self.bodies) and next(reversed(self.bodies)) >= nanos


class Witness:
    """Hears some sensors of a run, whose bodies it can forget."""

    def __init__(self, bus: Bus, run: str) -> None:
        self._streams = {name: Stream(bus, run, name, row) for name, row in STREAMS.items()}

    def forget(self) -> None:
        for stream in self._streams.values():
            stream.bodies = {}

    def heard(self, begin_nanos: int) -> dict[str, Bodies]:
        """Return what every sensor measured from an instant on, for as long as is compared."""
        end_nanos = begin_nanos + COMPARED_NANOS
        for name, stream in self._streams.items():
            what = f"{name} comes to {end_nanos / 1e9:g} s"
            wait_for(partial(stream.has_come_to, end_nanos), 90, what)
        return {
            name: {
                n: body for n, body in stream.bodies.copy().items() if begin_nanos <= n < end_nanos
            }
            for name, stream in self._streams.items()
        }


def groundlink(it: Rig, *words: str) -> str:
    line = [sys.executable, "-m", "groundlink", *words, "--connect", it.endpoint]
    done = subprocess.run(line, capture_output=True, text=True, timeout=100, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def end(up: subprocess.Popen[str]) -> None:
    up.send_signal(signal.SIGINT)
    assert up.wait(30) in (0, 1)  # whether rates were kept is not asked here


def assert_goes_on(whole: dict[str, Bodies], again: dict[str, Bodies]) -> None:
    for sensor, bodies in whole.items():
        assert list(again[sensor]) == list(bodies), sensor
        assert again[sensor] == bodies, sensor


def test_a_live_run_goes_back_and_another_goes_on_from_the_file(tmp_path: Path) -> None:
    file, recording = tmp_path / "half_way.run", tmp_path / "run.mcap"
    section = "time: {epoch: zero, clock_rate_hz: 400}\n"
    with rig(tmp_path, time_section=section) as it:
        up = it.up("--record", str(recording))
        watcher = Observer(it, "tests.system.ros_clock_watcher") if HAS_ROS else None
        wait_for(it.is_answered, 60, "the router listens")
        with Bus(connect=it.endpoint) as bus:
            witness = Witness(bus, it.run)
            command = bus.publisher(COMMAND.key_in(it.run, vehicle="rover"), COMMAND.delivery)
            witness.heard(0)
            command(Command(0, (0.8, 0.0, 0.0), (0.0, 0.0, 0.4)))
            groundlink(it, "save", str(file))
            saved_nanos = loaded(file.read_bytes(), "the file").tick * TICK_NANOS
            whole = witness.heard(saved_nanos)
            if watcher:
                wait_for(lambda: watcher.count("timer"), 60, "ROS follows")
                assert watcher.count("jump") == 0
            witness.forget()
            groundlink(it, "restore", str(file))
            assert_goes_on(whole, witness.heard(saved_nanos))
        if watcher:
            wait_for(lambda: watcher.count("jump"), 20, "ROS sees the jump")
            (jump,) = watcher.read()["jump"]
            assert jump["delta"] < 0
            assert jump["now"] >= saved_nanos
        assert (tmp_path / "run_2.mcap").exists()
        end(up)
        assert "Traceback" not in it.log("up.log")

        up = it.start(
            *("-m", "groundlink", "up", str(file), "--no-ros"),
            *("--run", it.run, "--listen", it.endpoint),
            log="up_again.log",
        )
        wait_for(it.is_answered, 60, "the router listens again")
        with Bus(connect=it.endpoint) as bus:
            assert_goes_on(whole, Witness(bus, it.run).heard(saved_nanos))
        end(up)
