# SPDX-License-Identifier: Apache-2.0
"""The default scenario, without its camera, as a user of ROS 1 Noetic sees it."""

import signal
import time
from itertools import pairwise
from pathlib import Path

import pytest
from rosbags.rosbag1 import Reader

from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.bus.topics import RELAYED
from groundlink.messages.base import Relayed
from groundlink.ros.types import STORE
from tests.system.rig import rig

from .conftest import Ros1

pytestmark = pytest.mark.system

PERIODS_NANOS = {"/points": 100_000_000, "/imu": 2_500_000, "/wheel_encoders": 20_000_000}
PATH = ("/plan", "nav_msgs/Path")
TOPICS = (
    ("sensor_msgs/PointCloud2", "/points"),
    ("sensor_msgs/Imu", "/imu"),
    ("groundlink_msgs/WheelEncoders", "/wheel_encoders"),
    ("rosgraph_msgs/Clock", "/clock"),
    ("tf2_msgs/TFMessage", "/tf_static"),
    ("diagnostic_msgs/DiagnosticArray", "/diagnostics"),
)


@pytest.mark.alone
def test_a_user_of_ros_1_sees_and_drives_the_rover(ros1: Ros1, tmp_path: Path) -> None:
    with rig(tmp_path, time_section="time: {mode: realtime}\n") as it:
        text = it.scenario.read_text(encoding="utf-8")
        more = text.replace("map: /map}", "map: /map, topics: {/plan: nav_msgs/Path}}")
        it.scenario.write_text(more, encoding="utf-8")
        node = ros1.bridge(it.address(it.peer))
        ears = ros1.listen(*TOPICS)
        it.up("--no-ros")
        ears.wait_until(lambda: len(ears.messages("/points")) > 20, "clouds")
        ears.wait_until(lambda: ears.messages("/diagnostics"), "diagnostics")
        for topic, period in PERIODS_NANOS.items():
            stamps = [stamp for stamp, _ in ears.messages(topic)][5:]
            steps = {late - early for early, late in pairwise(stamps)}
            assert steps == {period}, f"{topic}: a message is missing or out of order"
        frame, is_whole, _ = ears.messages("/points")[-1][1]
        assert is_whole
        assert ears.messages("/clock")
        late = ros1.listen(("tf2_msgs/TFMessage", "/tf_static"))  # who comes late hears it, too
        late.wait_until(lambda: late.messages("/tf_static"), "the latched transforms")
        assert frame in late.messages("/tf_static")[-1][1]

        ticks = ears.messages("/wheel_encoders")[-1][1][2]
        ros1.start(str(Path(__file__).with_name("driver.py")))
        ears.wait_until(
            lambda: min(ears.messages("/wheel_encoders")[-1][1][2]) > max(ticks) + 50, "it drives"
        )
        with Bus(connect=it.endpoint) as bus:  # what any other of its programs says comes back
            plans: BusInbox[Relayed] = BusInbox(depth=100)
            bus.subscribe(RELAYED.key_in(it.run), Relayed, plans)
            plan = "{header: {frame_id: map}, poses: [{pose: {position: {x: 2.5}}}]}"
            planner = ros1.start(*("/usr/bin/rostopic", "pub", "-r", "10"), *PATH, plan)
            arrived = plans.get(seconds=30)
            assert arrived, planner.output
            assert arrived[0] == RELAYED.key_in(it.run, vehicle="rover", topic="plan")
            body = STORE.deserialize_cdr(bytes(arrived[1].cdr), arrived[1].ros_type)
            assert (body.header.frame_id, body.poses[0].pose.position.x) == ("map", 2.5)
            planner.end(signal.SIGINT)
        bag = tmp_path / "run.bag"
        recorder = ros1.start("/usr/bin/rosbag", "record", "-O", str(bag), "/points", "/imu")
        meter = ros1.start("/usr/bin/rostopic", "hz", "/imu")
        meter.wait_for("average rate: [1-9]")
        ears.wait_until(lambda: Path(f"{bag}.active").exists(), "a bag")
        time.sleep(2)  # of data
        recorder.end(signal.SIGINT)
        with Reader(bag) as recorded:
            counts = {row.topic: row.msgcount for row in recorded.connections}
        assert counts["/imu"] > counts["/points"] > 0
        begun_s = time.monotonic()
        assert node.end(signal.SIGINT) == 0
        assert time.monotonic() - begun_s < 3, "Ctrl-C is to end it at once"
        # Of the clock a newer message may push out the one before; of the others none is missing.
        assert "lost 0, superseded" in node.output
        assert "refused 0" in node.output


def test_mistakes_are_one_line(ros1: Ros1) -> None:
    node = ros1.start("-m", "udp_bridge_ros1", "--bind", "nowhere")
    assert node.exit_code() == 2
    assert [line for line in node.lines if "nowhere" in line] == node.lines
