# SPDX-License-Identifier: Apache-2.0
"""What a recording becomes on the bus, and when it is due."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.core.clock import NANOS, TICK_NANOS
from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.messages.base import (
    POINT,
    BusMessage,
    Clock,
    Command,
    Imu,
    PointCloud,
    measured_nanos,
    packed,
)
from groundlink.messages.navigation import JointState, PoseStamped
from groundlink.recording.metadata import RUN_RECORD, describe_run, run_entries
from groundlink.recording.reader import Recording
from groundlink.recording.ros_channels import RosFile
from groundlink.ros.cdr import ROS_CODECS, to_cdr
from services.replay.__main__ import playback

EPOCH = 1_700_000_000 * NANOS
STILL = (0.0, 0.0, 0.0)
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
MS = 1_000_000


def clock(ms: int) -> Clock:
    return Clock(EPOCH + ms * MS, EPOCH, ms * MS // TICK_NANOS, EPOCH)


def imu(ms: int) -> Imu:
    return Imu(EPOCH + ms * MS, "imu_link", UPRIGHT, STILL, STILL, 1.0, 2.0, 3.0)


def cloud(ms: int) -> PointCloud:
    points = np.zeros(ms % 7 + 1, POINT)
    return PointCloud(EPOCH + ms * MS, "lidar_link", packed(points.view(np.uint8)))


def command(ms: int) -> Command:
    return Command(EPOCH + ms * MS, (0.25, 0.0, 0.0), STILL)


def pose(ms: int) -> PoseStamped:
    return PoseStamped(EPOCH + ms * MS, "map", STILL, UPRIGHT)


TOPICS: dict[type[BusMessage], str] = {
    Clock: "/clock",
    Imu: "/imu",
    PointCloud: "/points",
    Command: "/cmd_vel",
    PoseStamped: "/pose",
}

Recorded = Callable[[list[BusMessage]], Recording]


@pytest.fixture
def recorded(tmp_path: Path) -> Recorded:
    """Return a function that makes a recording of messages in this order."""

    def record(messages: list[BusMessage]) -> Recording:
        file = RosFile(tmp_path / "run.mcap")
        scenario = load(str(SHIPPED / "indoor_lab.yaml"))
        file.mcap.add_metadata(RUN_RECORD, run_entries(describe_run(scenario, "lab", EPOCH)))
        for message in messages:
            kind = type(message)
            topic = file.topic(TOPICS[kind], ROS_CODECS[kind].ros_type)
            topic.write(measured_nanos(message), to_cdr(message))
            file.mcap.commit("topics", {})  # a chunk for each
        file.mcap.close()
        return Recording(tmp_path / "run.mcap")

    return record


def played(recording: Recording, from_ms: int = 0) -> list[tuple[int, str, BusMessage]]:
    with recording:
        player = playback(recording, "again")
        return [
            ((due.nanos - EPOCH) // MS, due.key.removeprefix("groundlink/again/"), due.message)
            for due in player.play(EPOCH + from_ms * MS)
        ]


def test_a_cloud_is_due_when_its_revolution_is_over(recorded: Recorded) -> None:
    messages = [clock(0), cloud(0), imu(50), clock(100), imu(100), cloud(100), clock(110)]
    assert played(recorded(messages)) == [
        (0, "clock", clock(0)),
        (50, "rover/imu", imu(50)),
        (100, "clock", clock(100)),
        (100, "rover/lidar", cloud(0)),
        (100, "rover/imu", imu(100)),
        (110, "clock", clock(110)),
        (200, "rover/lidar", cloud(100)),
    ]


def test_the_order_of_time_whatever_the_order_of_arrival(recorded: Recorded) -> None:
    """In a fast run streams lag behind each other by up to a window."""
    messages = [clock(0), clock(10), clock(20), imu(5), imu(10), imu(15)]
    order = [(ms, key) for ms, key, _ in played(recorded(messages))]
    assert order == [
        *((0, "clock"), (5, "rover/imu"), (10, "clock"), (10, "rover/imu")),
        *((15, "rover/imu"), (20, "clock")),
    ]


def test_a_sensors_clock_that_was_off_is_off_again(recorded: Recorded) -> None:
    off = replace(imu(5), stamp_nanos=EPOCH - 995 * MS, clock_error_nanos=-1000 * MS)
    assert played(recorded([clock(0), off, clock(10), imu(15)])) == [
        (0, "clock", clock(0)),
        (5, "rover/imu", off),
        (10, "clock", clock(10)),
        (15, "rover/imu", imu(15)),
    ]


def test_from_an_instant_it_begins_with_a_clock(recorded: Recorded) -> None:
    messages = [clock(0), imu(5), clock(10), imu(15), clock(20), imu(25)]
    order = [(ms, key) for ms, key, _ in played(recorded(messages), from_ms=12)]
    assert order == [(20, "clock"), (25, "rover/imu")]


def test_replay_publishes_commands_but_no_stack_messages(recorded: Recorded) -> None:
    messages = [clock(0), command(4), pose(6), clock(10)]
    assert [key for _, key, _ in played(recorded(messages))] == ["clock", "rover/command", "clock"]


def test_commands_of_joints_are_played_with_where_they_were(tmp_path: Path) -> None:
    at, nothing = packed(np.array([0.5])), memoryview(b"")
    joints = JointState(EPOCH + 4 * MS, "", ("turret",), at, nothing, nothing)
    file = RosFile(tmp_path / "run.mcap")
    scenario = load(SHIPPED / "outdoor_paper.yaml")
    file.mcap.add_metadata(RUN_RECORD, run_entries(describe_run(scenario, "tank", EPOCH)))
    file.topic("/clock", "rosgraph_msgs/msg/Clock").write(EPOCH, to_cdr(clock(0)))
    for topic in ("/joint_commands", "/ground_truth/joints", "/joint_states"):
        file.topic(topic, "sensor_msgs/msg/JointState").write(EPOCH + 4 * MS, to_cdr(joints))
    file.mcap.commit("topics", {})
    file.mcap.close()
    assert played(Recording(tmp_path / "run.mcap")) == [
        (0, "clock", clock(0)),
        (4, "tank/command/joints", joints),
        (4, "tank/ground_truth/joints", joints),
    ]


def test_a_damaged_message_is_counted_and_passed_over(recorded: Recorded, tmp_path: Path) -> None:
    recording = recorded([clock(0), imu(5)])
    recording.close()
    file = RosFile(tmp_path / "other.mcap")
    file.mcap.add_metadata(RUN_RECORD, run_entries(recording.run))
    file.topic("/clock", "rosgraph_msgs/msg/Clock").write(EPOCH, to_cdr(clock(0)))
    file.topic("/imu", "sensor_msgs/msg/Imu").write(EPOCH, to_cdr(clock(0)))
    file.mcap.commit("topics", {})
    with Recording(tmp_path / "other.mcap") as damaged:
        player = playback(damaged, "again")
        assert [due.message for due in player.play(EPOCH)] == [clock(0)]
    assert player.refused == 1
