# SPDX-License-Identifier: Apache-2.0
"""System tests of overload: a slow sensor delays time, loses readings or aborts the run.

Each outcome is reported. The tests stop a sensor for a while to emulate an overloaded machine at a
known time.
"""

import json
import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from groundlink.bus.core_topics import CLOCK, BusTopic
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.bus.topics import MISSING_READINGS, SENSOR_TOPICS
from groundlink.core.clock import TICK_NANOS
from groundlink.messages.base import BusMessage, Clock, Imu, PointCloud, WheelEncoders
from groundlink.messages.missing_readings import MissingReadings, MissingSpan
from groundlink.scenario.lockstep_window import HISTORY_TICKS

from .rig import Rig, children_of, rig, wait_for

pytestmark = pytest.mark.system

LIDAR = "rover/lidar"
LIDAR_PERIOD = 100_000_000
STREAMS: dict[str, tuple[BusTopic, type[BusMessage], int]] = {
    "lidar": (SENSOR_TOPICS["lidar"], PointCloud, LIDAR_PERIOD),
    "imu": (SENSOR_TOPICS["imu"], Imu, 2_500_000),
    "encoders": (SENSOR_TOPICS["encoders"], WheelEncoders, 20_000_000),
}
STOPPED_SECONDS = 4.0
WINDOW_TICKS = 400
"""So far behind may a sensor of the default scenario be."""


class Run:
    """A run under a supervisor, and all that its sensors say."""

    def __init__(self, it: Rig, bus: Bus) -> None:
        self._rig = it
        self._report = it.folder / "report.json"
        self._inboxes: dict[str, BusInbox[BusMessage]] = {}
        for name, (row, message, _) in STREAMS.items():
            inbox: BusInbox[BusMessage] = BusInbox(depth=100_000)
            bus.subscribe(row.key_in(it.run, vehicle="rover", sensor=name), message, inbox)
            self._inboxes[name] = inbox
        self._missing: BusInbox[MissingReadings] = BusInbox(depth=1000)
        bus.subscribe(
            MISSING_READINGS.key_in(it.run, process=LIDAR), MissingReadings, self._missing
        )
        self._stamps: dict[str, list[int]] = {name: [] for name in STREAMS}
        self._told: list[MissingSpan] = []

    def stamps(self, name: str) -> NDArray[np.int64]:
        """Return the stamps of a sensor's readings up to now."""
        while arrived := self._inboxes[name].get(seconds=0):
            stamp: int = arrived[1].stamp_nanos  # type: ignore[attr-defined]
            self._stamps[name].append(stamp)
        return np.array(self._stamps[name])

    def gaps(self) -> list[MissingSpan]:
        """Return what the LiDAR has told to be missing up to now."""
        while arrived := self._missing.get(seconds=0):
            self._told += arrived[1].gaps
        return self._told

    def goes_on(self, readings: int = 10) -> None:
        """Wait for more readings of every sensor."""
        wanted = {name: len(self.stamps(name)) + readings for name in STREAMS}
        for name, count in wanted.items():
            wait_for(lambda n=name, c=count: len(self.stamps(n)) >= c, 60, f"{name} publishes")

    def stop_lidar(self, condition: Any) -> None:
        """Let the LiDAR stand still until a condition holds."""
        children = children_of(self._rig.started[0].pid)
        pid = next(pid for pid, command in children.items() if "sensors.lidar" in command)
        os.kill(pid, signal.SIGSTOP)
        try:
            wait_for(condition, 60, "what the stop is for")
        finally:
            if os.path.exists(f"/proc/{pid}"):
                os.kill(pid, signal.SIGCONT)

    def end(self) -> dict[str, Any]:
        """End the run; return the supervisor's report."""
        supervisor = self._rig.started[0]
        if supervisor.poll() is None:
            supervisor.send_signal(signal.SIGINT)
        supervisor.wait(15)
        report: dict[str, Any] = json.loads(self._report.read_text(encoding="utf-8"))
        return report


@contextmanager
def run(folder: Path, time_section: str, *more: str) -> Iterator[tuple[Rig, Run]]:
    with rig(folder, time_section=f"time: {{{time_section}}}\n") as it:
        it.up("--no-ros", "--report", str(folder / "report.json"), *more)
        wait_for(it.is_answered, 20, "the bus opens")
        with Bus(connect=it.endpoint) as bus:
            begun = Run(it, bus)
            begun.goes_on()
            yield it, begun


def seconds_passed() -> Any:
    """Return a condition that holds after the sensor has stood still for long enough."""
    until = time.monotonic() + STOPPED_SECONDS
    return lambda: time.monotonic() > until


def test_slow_lets_time_stretch_and_no_reading_out(tmp_path: Path) -> None:
    with run(tmp_path, "overload: slow, deadline_s: 60") as (it, begun):
        begun.stop_lidar(seconds_passed())
        begun.goes_on()
        for name, (_, _, period) in STREAMS.items():
            assert set(np.diff(begun.stamps(name)).tolist()) == {period}, name
        report = begun.end()
    # Of the time it stood still, a window of 400 ticks has passed for the others.
    stretched = report["stalls"]["stretched_seconds"]
    assert stretched[LIDAR] > 0.8 * (STOPPED_SECONDS - 1.0)
    # On a busy machine others stretch time as well, but not as much as what stood still.
    assert stretched[LIDAR] > 0.5 * sum(stretched.values())
    assert report["real_time_factor"] < 0.97
    assert "time stretched by" in it.log("up.log")
    assert report["stalls"]["silent_seconds"] == {}


def test_slow_names_a_silent_sensor_and_continues_without_it(tmp_path: Path) -> None:
    with run(tmp_path, "overload: slow, deadline_s: 1.5") as (it, begun):
        begun.stop_lidar(lambda: f"continuing without {LIDAR}" in it.log("up.log"))
        assert f"has waited 1.5 s for {LIDAR}" in it.log("up.log")
        wait_for(lambda: f"{LIDAR} is responding again after" in it.log("up.log"), 20, "it is back")
        begun.goes_on(20)  # for two seconds: physics tells its stalls once a second
        report = begun.end()
    assert report["stalls"]["silent_seconds"][LIDAR] >= 1.5


def test_skip_lets_readings_out_and_marks_each_but_no_time_stretch(tmp_path: Path) -> None:
    with run(tmp_path, "overload: skip") as (it, begun):
        begun.stop_lidar(seconds_passed())
        begun.goes_on()
        stamps = begun.stamps("lidar")
        missing = int((stamps[-1] - stamps[0]) // LIDAR_PERIOD) + 1 - len(stamps)
        assert missing > 10

        def marked() -> int:
            """Return how many readings are told to be missing between the first and the last."""
            inside = [g for g in begun.gaps() if stamps[0] < g.first_nanos < stamps[-1]]
            assert {gap.cause for gap in inside} == {"overloaded"}
            return sum(gap.readings for gap in inside)

        wait_for(lambda: marked() == missing, 20, f"{missing} readings are marked")
        wait_for(lambda: f"{LIDAR}: 10 Hz again after" in it.log("up.log"), 60, "the log says so")
        begins = (f"{LIDAR}: no readings for", "of 10 Hz (machine overloaded: readings missing")
        assert any(begin in it.log("up.log") for begin in begins)
        report = begun.end()
    # What physics is behind by on a busy machine it makes up for.
    assert report["stalls"]["stretched_seconds"] == {}


@pytest.mark.parametrize("mode", ["realtime", "lockstep"])
def test_fail_ends_the_run_in_one_line(tmp_path: Path, mode: str) -> None:
    with run(tmp_path, f"mode: {mode}, overload: fail, deadline_s: 3") as (it, begun):
        supervisor = it.started[0]
        children = children_of(supervisor.pid)
        begun.stop_lidar(lambda: supervisor.poll() is not None)
        assert supervisor.poll() == 1
        assert not [pid for pid in children if os.path.exists(f"/proc/{pid}/exe")]
        lines = it.log("up.log").splitlines()
        [why] = [line for line in lines if "run aborted by `overload: fail`" in line]
        assert LIDAR in why
        assert "Traceback" not in it.log("up.log")
        assert begun.end()["processes"]["physics"]["last_exit"] == "exit code 4"


def test_fail_ends_a_run_whose_readings_get_lost(tmp_path: Path) -> None:
    """A sensor that is killed is started again, but has missed more than physics keeps for it."""
    of_its_own = ("--set", "imu.process=own")
    with run(tmp_path, "overload: fail, deadline_s: 60", *of_its_own) as (it, begun):
        supervisor = it.started[0]

        def imu() -> int:
            children = children_of(supervisor.pid)
            return next((pid for pid, said in children.items() if "sensors.imu" in said), 0)

        def hold_successor() -> int:
            """Kill the sensor; stop its successor at once, before it joins the run."""
            killed = imu()
            os.kill(killed, signal.SIGKILL)
            wait_for(lambda: imu() not in (0, killed), 30, "its successor")
            successor = imu()
            os.kill(successor, signal.SIGSTOP)
            return successor

        def passes(ticks: int, seconds: float) -> bool:
            later = begun.stamps("encoders")[-1] + ticks * TICK_NANOS
            with suppress(AssertionError):
                wait_for(lambda: begun.stamps("encoders")[-1] > later, seconds, "time goes on")
            return bool(begun.stamps("encoders")[-1] > later)

        # Where this test was too slow the successor has joined, and the run waits for it.
        for _ in range(4):
            successor = hold_successor()
            if passes(2 * WINDOW_TICKS, 10):
                break
        try:
            # Until physics has forgotten what comes next.
            assert passes(2 * HISTORY_TICKS, 60), "time goes on"
        finally:
            os.kill(successor, signal.SIGCONT)
        assert supervisor.wait(60) == 1
        assert "rover/imu: missing readings: " in it.log("up.log")
        assert " restarted; run aborted by `overload: fail`" in it.log("up.log")


def test_stamps_are_back_at_the_wall_clock_after_a_stall(tmp_path: Path) -> None:
    """Of many clocks the youngest counts: a machine with other work delivers some of them late."""
    with rig(tmp_path) as it:
        physics = it.start(
            *("-m", "services.physics", str(it.scenario)),
            *("--run", it.run, "--listen", it.endpoint),
            log="physics.log",
        )
        wait_for(it.is_answered, 20, "the bus opens")
        with Bus(connect=it.endpoint) as bus:
            inbox: BusInbox[Clock] = BusInbox(depth=10_000)
            bus.subscribe(CLOCK.key_in(it.run), Clock, inbox)

            def age_seconds() -> float:
                """Return the age of the youngest of the next 20 clocks."""
                while len(inbox):
                    inbox.get(seconds=0)
                ages = []
                while len(ages) < 20:
                    if arrived := inbox.get(seconds=20):
                        ages.append((time.time_ns() - arrived[1].stamp_nanos) * 1e-9)
                return min(ages)

            before = age_seconds()
            os.kill(physics.pid, signal.SIGSTOP)
            time.sleep(0.8)
            os.kill(physics.pid, signal.SIGCONT)
            assert age_seconds() > before + 0.4
            wait_for(lambda: age_seconds() < before + 0.05, 60, "stamps are back")
