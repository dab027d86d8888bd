# SPDX-License-Identifier: Apache-2.0
"""One program follows the wall by ROS 1, by ROS 2 and on the bus: the same way, bit by bit.

Its decisions are in `tests/system/wall_following.py`. In lockstep they depend on the data alone, so
whatever way the data take, the vehicle goes the same way.
"""

import math
import shutil
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest

from groundlink.bus.core_topics import STATE
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.messages.base import State
from tests.system import wall_following
from tests.system.rig import Rig, rig, wait_for

from .conftest import Ros1

pytestmark = [pytest.mark.system, pytest.mark.timeout(300)]

SHORT_TICKS = 800
LAP_TICKS = 8000
"""20 s: a lap and some of the next one."""

ROOM = """
name: hall
materials:
  plaster: {reflectivity: 0.8, friction: 1.0}
room: {size_m: [5.0, 4.2, 2.0], wall_thickness_m: 0.15, wall_material: plaster,
  floor_material: plaster}
"""
SCENARIO = """
name: laps
seed: 5
world: hall.yaml
time: {{mode: fast, lockstep: ros, epoch: zero, clock_rate_hz: 50.0, answers: {{/cmd_vel: /odom}}}}
gateway: {{bind: {bind}, peer: {peer}}}
vehicles:
  - name: rover
    model: {rover}
    placement: {{x_m: -0.5, y_m: -1.1}}
    sensors:
      - {{kind: lidar_2d, datasheet: {scanner}, name: scanner, topic: /scan, frame: scan_link,
         mount: mast}}
      - {{kind: encoders, name: encoders, topic: /wheel_encoders, frame: base_link, rate_hz: 50.0}}
      - {{kind: wheel_odometry, name: odometry, encoders: encoders, topic: /odom, frame: odom}}
"""
LAPS = "9"


def with_ros_1(it: Rig, ros1: Ros1) -> None:
    ros1.bridge(it.address(it.peer))
    shutil.copy(Path(wall_following.__file__), ros1.folder)
    ros1.start(str(Path(__file__).with_name("wall_follower.py")), LAPS)
    it.up("--no-ros")


def with_ros_2(it: Rig, _: Ros1) -> None:
    it.start("-m", "tests.system.wall_follower_ros2", LAPS, log="follower.log")
    it.up()


def on_the_bus(it: Rig, _: Ros1) -> None:
    """Without a gateway: what follows the wall stands in its place."""
    here = ("--run", it.run, "--connect", it.endpoint)
    it.start(
        *("-m", "services.physics", str(it.scenario), "--run", it.run, "--listen", it.endpoint),
        log="up.log",
    )
    it.start("-m", "services.sensors", *here, log="sensors.log")
    it.start("-m", "tests.system.wall_follower_bus", LAPS, *here, log="follower.log")


def driven(folder: Path, start: Callable[[Rig, Ros1], None], ros1: Ros1, ticks: int) -> list[bytes]:
    """Return the poses of the base up to a tick, as one bin each."""
    folder.mkdir()
    with rig(folder) as it:
        shipped = Path(__file__).resolve().parents[2] / "scenarios"
        (folder / "hall.yaml").write_text(ROOM)
        places = {
            "bind": it.address(it.bind),
            "peer": it.address(it.peer),
            "rover": shipped / "vehicles/rover.yaml",
            "scanner": shipped / "sensors/rplidar_a2.yaml",
        }
        it.scenario.write_text(SCENARIO.format(**places), encoding="utf-8")
        states: BusInbox[State] = BusInbox(depth=1 << 16)
        start(it, ros1)
        wait_for(it.is_answered, 60, "a router")
        with Bus(connect=it.endpoint) as bus:
            bus.subscribe(STATE.key_in(it.run), State, states)
            way: list[bytes] = []

            def has_come() -> bool:
                while len(way) <= ticks and len(states) and (got := states.get(seconds=0)):
                    assert got[1].tick == len(way), "the test itself has missed states"
                    way.append(bytes(got[1].vehicles["rover"].link_poses[:56]))
                return len(way) > ticks

            wait_for(has_come, 200, f"tick {ticks}: {it.log('up.log')[-2000:]}")
    return way


@pytest.mark.parametrize("ticks", [SHORT_TICKS, pytest.param(LAP_TICKS, marks=pytest.mark.nightly)])
def test_the_same_laps_whatever_way_the_data_take(ros1: Ros1, tmp_path: Path, ticks: int) -> None:
    pytest.importorskip("rclpy", reason="no ROS 2 here")
    ways = {
        start.__name__: driven(tmp_path / start.__name__, start, ros1, ticks)
        for start in (on_the_bus, with_ros_1, with_ros_2)
    }
    bus = ways["on_the_bus"]
    poses = [memoryview(pose).cast("d").tolist() for pose in bus[::40]]
    yaws = [2 * math.atan2(pose[5], pose[6]) for pose in poses]
    turns = (math.remainder(b - a, 2 * math.pi) for a, b in pairwise(yaws))
    assert max(abs(pose[0]) for pose in poses) > 0.6, "it has not driven"
    assert ticks < LAP_TICKS or sum(turns) > 2 * math.pi, "it has not gone round"
    for name, way in ways.items():
        first = next((tick for tick in range(ticks) if way[tick] != bus[tick]), None)
        assert first is None, f"{name}: another way from tick {first} on"
