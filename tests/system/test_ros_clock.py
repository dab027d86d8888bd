# SPDX-License-Identifier: Apache-2.0
"""System tests of a ROS 2 node with use_sim_time: timers, a pause and a reset."""

import subprocess
import sys
import time
from collections.abc import Iterator

import pytest

from .rig import REPOSITORY, Observer, Rig, rig, wait_for

pytest.importorskip("rclpy", reason="no ROS 2 here")
pytestmark = pytest.mark.system

TIMER_NANOS = 50_000_000
CLOCK_NANOS = 2_500_000
"""Of 400 Hz."""


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Rig, Observer]]:
    time_section = "time: {epoch: zero, clock_rate_hz: 400}\n"
    with rig(tmp_path_factory.mktemp("run"), time_section=time_section) as it:
        physics = ("-m", "services.physics", str(it.scenario), "--listen", it.endpoint)
        it.start(*physics, "--only", "rover/imu", "--run", it.run, log="physics.log")
        wait_for(it.is_answered, 20, "physics listens")
        of_run = ("--run", it.run, "--connect", it.endpoint)
        it.start("-m", "services.gateway", *of_run, log="gateway.log")
        it.start("-m", "udp_bridge_ros2", "--bind", it.address(it.peer), log="node.log")
        watcher = Observer(it, "tests.system.ros_clock_watcher")
        wait_for(lambda: watcher.count("timer") > 20, 60, f"timers: {it.log('observer.log')}")
        yield it, watcher


def groundlink(it: Rig, *words: str) -> None:
    command = [sys.executable, "-m", "groundlink", *words, "--run", it.run]
    subprocess.run([*command, "--connect", it.endpoint], cwd=REPOSITORY, check=True, timeout=60)


def fired(watcher: Observer) -> list[int]:
    return [told["now"] for told in watcher.read()["timer"]]


def test_timers_fire_by_sim_time_at_every_tick(running: tuple[Rig, Observer]) -> None:
    times = fired(running[1])
    assert all(now % CLOCK_NANOS == 0 for now in times)
    assert times == sorted(times)
    periods = (times[-1] - times[0]) / TIMER_NANOS
    # A busy machine may let one fire late, and rclpy then leaves some out; none is made up.
    assert 0.5 * periods <= len(times) - 1 <= periods + 1


def test_a_pause_stops_the_clock(running: tuple[Rig, Observer]) -> None:
    it, watcher = running
    groundlink(it, "pause")
    time.sleep(0.5)  # what was on its way
    stands = fired(watcher)[-1]
    time.sleep(0.5)  # that nothing comes has no event to wait for
    assert fired(watcher)[-1] == stands
    groundlink(it, "step", "40")
    wait_for(lambda: fired(watcher)[-1] > stands, 20, "two periods more")
    assert fired(watcher)[-1] <= stands + 40 * CLOCK_NANOS + TIMER_NANOS
    groundlink(it, "resume")
    wait_for(lambda: fired(watcher)[-1] > stands + 10 * TIMER_NANOS, 20, "time goes on")


def test_a_reset_is_a_jump_back(running: tuple[Rig, Observer]) -> None:
    it, watcher = running
    assert watcher.count("jump") == 0
    before = fired(watcher)[-1]
    groundlink(it, "reset")
    wait_for(lambda: watcher.count("jump"), 20, "a jump")
    (jump,) = watcher.read()["jump"]
    assert jump["delta"] <= -before
    assert jump["now"] < 400 * CLOCK_NANOS
    wait_for(lambda: fired(watcher)[-1] < before, 20, "timers go on from there")
