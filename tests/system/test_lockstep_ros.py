# SPDX-License-Identifier: Apache-2.0
"""System tests of a ROS 2 controller in lockstep: a bit-identical trajectory in every run."""

import hashlib
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from groundlink.bus.core_topics import STATE
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.messages.base import State, encode, floats

from .rig import Rig, children_of, rig, wait_for

pytest.importorskip("rclpy", reason="no ROS 2 here")
pytestmark = pytest.mark.system

TICKS = 800
"""Two seconds."""

VEHICLES = """
vehicles:
  - name: rover
    model: vehicles/rover.yaml
    sensors:
      - {kind: imu, datasheet: sensors/imu_mti1.yaml, name: imu, topic: /imu, frame: imu_link,
         mount: imu}
      - {kind: encoders, name: encoders, topic: /wheel_encoders, frame: base_link, rate_hz: 50.0}
      - {kind: wheel_odometry, name: odometry, encoders: encoders, topic: /odom, frame: odom}
"""
TANK = """
vehicles:
  - name: tank
    model: vehicles/tank.yaml
    from_ros: {joints: /joint_commands}
    sensors:
      - {kind: imu, datasheet: sensors/imu_mti1.yaml, name: imu, topic: /imu, frame: imu_link,
         mount: imu}
"""
ANSWERS = {
    "odom": "/cmd_vel: /odom",
    "timer": "/cmd_vel: /clock",
    "joints": "/joint_commands: /clock",
}
LOSS = ", link: {seed: 3, to_ros: {loss: 0.05}, from_ros: {loss: 0.05}}"


def write(it: Rig, *, way: str, link: str = "") -> None:
    it.scenario.write_text(
        "name: loop\nseed: 7\nworld: worlds/lab.yaml\n"
        "time: {mode: fast, lockstep: ros, epoch: zero, clock_rate_hz: 50.0, "
        f"answers: {{{ANSWERS[way]}}}}}\n"
        f"gateway: {{bind: {it.address(it.bind)}, peer: {it.address(it.peer)}{link}}}\n"
        + (TANK if way == "joints" else VEHICLES),
        encoding="utf-8",
    )


class Way:
    """Listens to where the vehicle and its joints are, from tick 0 to the end."""

    def __init__(self, bus: Bus, run: str) -> None:
        self._states: BusInbox[State] = BusInbox(depth=1 << 16)
        self._digest = hashlib.sha256()
        self.tick = -1
        self.end_m = (0.0, 0.0)
        self.joints: list[float] = []
        bus.subscribe(STATE.key_in(run), State, self._states)

    def has_come_to(self, tick: int) -> bool:
        """Take in states up to a tick; return whether all of them were there."""
        while self.tick < tick and len(self._states) and (got := self._states.get(seconds=0)):
            state = got[1]
            assert state.tick == self.tick + 1, "the test itself has missed states"
            self.tick = state.tick
            self._digest.update(encode(State("", 0, 0, state.tick, 0, "", state.vehicles)))
            (vehicle,) = state.vehicles.values()
            x, y, *_ = vehicle.poses()[0].tolist()
            self.end_m = x, y
            self.joints = floats(vehicle.servo_positions).tolist()
        return self.tick >= tick

    @property
    def digest(self) -> str:
        return self._digest.hexdigest()


@contextmanager
def driving(
    folder: Path, *, way: str, delay_s: float = 0.0, link: str = ""
) -> Iterator[tuple[Rig, Way]]:
    """A run with a controller; yields it, and the way that is driven."""
    folder.mkdir()
    with rig(folder) as it:
        write(it, way=way, link=link)
        it.start("-m", "tests.system.ros_controller", way, str(delay_s), log="controller.log")
        it.up()
        wait_for(it.is_answered, 60, "a router")
        with Bus(connect=it.endpoint) as bus:  # long before the sensors, which physics waits for
            yield it, Way(bus, it.run)


def driven(folder: Path, **how: Any) -> str:
    """Return in short the way that a controller has driven in a run of its own."""
    with driving(folder, **how) as (it, seen):
        wait_for(lambda: seen.has_come_to(TICKS), 300, f"tick {TICKS}: {it.log('up.log')}")
    assert seen.end_m[0] > 1.0, "it has not driven"
    return seen.digest


def process_of(it: Rig, module: str) -> int:
    """Return the number of a process that `groundlink up` has started; 0 where there is none."""
    _, up, *_ = it.started
    return next((pid for pid, said in children_of(up.pid).items() if module in said), 0)


@pytest.mark.parametrize("way", ["odom", "timer"])
def test_the_way_is_the_same_whatever_delays_and_losses(tmp_path: Path, way: str) -> None:
    undisturbed = driven(tmp_path / "undisturbed", way=way)
    assert driven(tmp_path / "disturbed", way=way, delay_s=0.03, link=LOSS) == undisturbed


def test_joints_follow_ros_commands_and_joint_states(tmp_path: Path) -> None:
    """Each tick that ROS answers waits for the command of the joints, whenever it comes."""
    digests = []
    for delay_s, link in ((0.0, ""), (0.03, LOSS)):
        folder = tmp_path / str(delay_s)
        with driving(folder, way="joints", delay_s=delay_s, link=link) as (it, seen):
            come = partial(seen.has_come_to, 400)
            wait_for(come, 120, f"a second: {it.log('up.log')}")
            turret, gun = seen.joints
            rows = [line.split() for line in it.log("controller.log").splitlines()]
        digests.append(seen.digest)
        # It is slower than what it is told, and has gone at its top speed.
        assert turret > 0.1
        assert gun > 0.02
        told = {row[0]: [float(word) for word in row[5:]] for row in rows if len(row) == 9}
        names = ["left_track", "right_track", "turret", "gun"]
        assert [row[1:5] for row in rows] == [names] * len(rows)
        left, right, turned, _ = max(told.values())
        assert turned == pytest.approx(turret, abs=0.05)
        # A second at 4 rad/s, after the ramp; the sprockets have a radius of 0.4 m.
        assert left == pytest.approx(right)
        assert left > 1.0
        assert seen.end_m[0] == pytest.approx(0.405 * left, abs=0.15)
    assert digests[0] == digests[1]


@pytest.fixture(scope="module")
def loop(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Rig, Way]]:
    """A run that has begun, of which processes are ended and started again."""
    with driving(tmp_path_factory.mktemp("loop") / "run", way="odom") as (it, seen):
        wait_for(lambda: seen.has_come_to(200), 60, f"tick 200: {it.log('up.log')}")
        yield it, seen


@pytest.mark.parametrize("module", ["udp_bridge_ros2", "services.gateway"])
def test_restarted_process_participates_again(loop: tuple[Rig, Way], module: str) -> None:
    it, seen = loop
    killed = process_of(it, module)
    os.kill(killed, signal.SIGKILL)
    wait_for(lambda: process_of(it, module) not in (0, killed), 30, "its successor")
    seen.has_come_to(10**6)
    last = seen.tick + 400
    wait_for(lambda: seen.has_come_to(last), 60, f"tick {last}: {it.log('up.log')}")


def test_time_waits_for_a_controller_and_says_so(loop: tuple[Rig, Way]) -> None:
    it, seen = loop
    said_before = len(it.log("up.log"))

    def is_said(line: str) -> bool:
        return line in it.log("up.log")[said_before:]

    controller, *_ = it.started
    controller.send_signal(signal.SIGINT)
    controller.wait(10)
    wait_for(lambda: is_said("has been waiting for /cmd_vel since"), 30, "a line")
    wait_for(lambda: is_said("lockstep: tick"), 10, "the node's line")
    seen.has_come_to(10**6)
    stands_at = seen.tick
    it.start("-m", "tests.system.ros_controller", "odom", "0", log="second.log")
    wait_for(lambda: seen.has_come_to(stands_at + 200), 60, "time goes on")
