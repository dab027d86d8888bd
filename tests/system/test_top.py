# SPDX-License-Identifier: Apache-2.0
"""System tests of `groundlink top` and `drive`: crashed processes are shown, the vehicle moves."""

import json
import os
import pty
import select
import signal
import subprocess
import sys
import termios
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.bus.topics import GROUND_TRUTH
from groundlink.messages.navigation import Odometry

from .rig import REPOSITORY, Rig, rig, wait_for
from .test_name_claims import start_sensor

pytestmark = pytest.mark.system


@pytest.fixture(scope="module")
def sensor_only(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Rig, int]]:
    """Physics and one sensor, in real time; with the sensor's process id."""
    with rig(tmp_path_factory.mktemp("run")) as it:
        physics = ("-m", "services.physics", str(it.scenario), "--listen", it.endpoint)
        it.start(*physics, log="physics.log")
        wait_for(it.is_answered, 20, "physics listens")
        yield it, start_sensor(it, "imu")


def states(it: Rig) -> dict[str, dict[str, Any]]:
    """Return the processes of the last line that `top --json` has printed, by name."""
    lines = it.log("top.log").splitlines()
    return {row["name"]: row for row in json.loads(lines[-1])["processes"]} if lines else {}


@pytest.mark.alone
def test_once_is_a_picture_and_ends(sensor_only: tuple[Rig, int]) -> None:
    it, _ = sensor_only
    command = [sys.executable, "-m", "groundlink", "top", "--once", "--connect", it.endpoint]
    done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=False)
    assert done.returncode == 0, done.stderr
    [imu] = [line for line in done.stdout.splitlines() if "rover/imu" in line]
    assert "alive" in imu
    assert "400 Hz" in imu


class Typist:
    """A terminal with one of the commands in it."""

    def __init__(self, it: Rig, name: str) -> None:
        self.end, theirs = pty.openpty()
        self.before = termios.tcgetattr(theirs)
        self._theirs = theirs
        command = [sys.executable, "-m", "groundlink", name, "--connect", it.endpoint]
        self.process = subprocess.Popen(
            command, stdin=theirs, stdout=theirs, stderr=theirs, cwd=REPOSITORY
        )
        self.shown = ""

    def read(self) -> str:
        while select.select([self.end], [], [], 0)[0]:
            self.shown += os.read(self.end, 4096).decode(errors="replace")
        return self.shown

    def is_as_before(self) -> bool:
        return termios.tcgetattr(self._theirs) == self.before

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        os.close(self.end)
        os.close(self._theirs)


class Watcher:
    """How fast the rover goes, by its ground truth."""

    def __init__(self, bus: Bus) -> None:
        self._truths: BusInbox[Odometry] = BusInbox(depth=2)
        key = GROUND_TRUTH.key_in("indoor_lab", vehicle="rover")
        bus.subscribe(key, Odometry, self._truths)

    def speed_mps(self) -> float:
        arrived = self._truths.get(seconds=5)
        assert arrived
        return arrived[1].linear_mps[0]


@pytest.mark.parametrize("end", [b"q", signal.SIGINT, signal.SIGTERM])
def test_keys_drive_and_the_terminal_is_as_before(
    sensor_only: tuple[Rig, int], end: bytes | signal.Signals
) -> None:
    it, _ = sensor_only
    typist = Typist(it, "drive")
    try:
        with Bus(connect=it.endpoint) as bus:
            watcher = Watcher(bus)
            wait_for(lambda: "drive" in typist.read(), 20, "it is ready")
            wait_for(lambda: not typist.is_as_before(), 20, "keys come one by one")

            def goes() -> bool:
                os.write(typist.end, b"w")
                return watcher.speed_mps() > 0.4

            wait_for(goes, 30, "the rover drives ahead")
            assert "+0.50 m/s" in typist.read()
            wait_for(lambda: abs(watcher.speed_mps()) < 0.02, 20, "who lets go stops")
            if isinstance(end, bytes):
                os.write(typist.end, end)
            else:
                typist.process.send_signal(end)
            assert typist.process.wait(30) == 0
        assert typist.is_as_before()
    finally:
        typist.close()


def test_the_live_table_ends_with_its_terminal_as_before(sensor_only: tuple[Rig, int]) -> None:
    it, _ = sensor_only
    typist = Typist(it, "top")
    try:
        wait_for(lambda: "400.0 Hz" in typist.read(), 20, "a rate is shown")
        assert "rover/imu" in typist.read()
        typist.process.send_signal(signal.SIGINT)
        assert typist.process.wait(30) == 0
        assert typist.is_as_before()
        assert "Traceback" not in typist.read()
    finally:
        typist.close()


def test_without_a_terminal_one_line_says_so(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "groundlink", "drive"]
    done = subprocess.run(
        command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=30, check=False
    )
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "requires a terminal" in done.stderr
    assert "--route" in done.stderr


def test_a_route_is_driven_from_where_the_vehicle_stands(sensor_only: tuple[Rig, int]) -> None:
    it, _ = sensor_only
    route = it.folder / "route.yaml"
    route.write_text("kind: there_and_back\nlength_m: 0.3\nspeed_mps: 0.5\n", encoding="utf-8")
    command = ("-m", "groundlink", "drive", "rover", "--connect", it.endpoint)
    driver = it.start(*command, "--route", str(route), log="drive.log")
    begun = time.monotonic()
    assert driver.wait(90) == 0, it.log("drive.log")
    assert time.monotonic() - begun > 1.0
    assert it.log("drive.log").count("the route is driven") == 1
    wrong = it.start(*command, "--route", "triangle", log="wrong.log")
    assert wrong.wait(20) == 2
    assert "no figure `triangle`" in it.log("wrong.log")


@pytest.mark.alone
def test_a_process_that_dies_is_gone_within_two_seconds(sensor_only: tuple[Rig, int]) -> None:
    """The last test of this run, for the sensor is not started again."""
    it, imu = sensor_only
    it.start("-m", "groundlink", "top", "--json", "--connect", it.endpoint, log="top.log")
    wait_for(lambda: states(it).get("rover/imu", {}).get("measured_hz"), 20, "a rate is measured")
    now = states(it)
    assert now["rover/imu"]["state"] == "alive"
    assert now["rover/imu"]["measured_hz"] == pytest.approx(400.0, rel=0.02)
    assert now["rover/imu"]["pid"] == imu
    assert now["physics"]["host"] == os.uname().nodename
    assert now["rover/lidar"]["state"] == "missing"
    [mission] = json.loads(it.log("top.log").splitlines()[-1])["missions"]
    assert (mission["vehicle"], mission["state"], mission["failure"]) == ("rover", "standing", None)
    assert mission["seconds"] > 0
    os.kill(imu, signal.SIGKILL)
    wait_for(lambda: states(it)["rover/imu"]["state"] == "gone", 2.0, "it is gone")
