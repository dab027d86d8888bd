# SPDX-License-Identifier: Apache-2.0
"""The gateway between a stand-in of the link and a list of commands."""

from __future__ import annotations

import math
import struct
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from groundlink.messages import (
    POINT,
    Clock,
    Command,
    Imu,
    Message,
    PointCloud,
    WheelEncoders,
    packed,
)
from groundlink.ros_messages import WHEEL_ENCODERS_DEFINITION
from groundlink.scenario import load
from groundlink.scenario.load import SHIPPED
from services.gateway.gateway import Gateway
from services.gateway.streams import TF_MESSAGE, TWIST, outgoing
from udp_bridge.control import LinkReport, Subscribe, TopicReport
from udp_bridge.message import Message as WireMessage
from udp_bridge.types import CONTROL, SUBSCRIBE

PEER = ("127.0.0.1", 7511)
STRANGER = ("127.0.0.1", 9999)
RUN = "lab"
STORE = get_typestore(Stores.ROS2_KILTED)
STORE.register(get_types_from_msg(WHEEL_ENCODERS_DEFINITION, "groundlink_msgs/msg/WheelEncoders"))


class RecordingLink:
    """Keeps what would go on the wire."""

    def __init__(self) -> None:
        self.sent: list[dict[str, Any]] = []

    def send(
        self, msg_type: int, topic: str, link: str, stamp_nanos: int, body: Any, to: Any
    ) -> None:
        self.sent.append(
            {
                "msg_type": msg_type,
                "topic": topic,
                "link": link,
                "stamp": stamp_nanos,
                "body": bytes(body),
                "to": to,
            }
        )


class Bench:
    """A gateway of the shipped scenario with nothing real around it."""

    def __init__(self) -> None:
        self.commands: list[tuple[str, Command]] = []
        self.link = RecordingLink()
        self.gateway = Gateway(
            load(SHIPPED / "indoor_lab.yaml"),
            RUN,
            peer=PEER,
            publish_command=lambda key, command: self.commands.append((key, command)),
        )

    def forward(self, name: str, message: Message) -> None:
        self.gateway.forward(f"groundlink/{RUN}/{name}", message, self.link)  # type: ignore[arg-type]

    def hear(self, msg_type: int, topic: str, body: bytes, sender: Any = PEER) -> None:
        self.gateway.on_message(WireMessage(msg_type, topic, "", 5, 0, body), sender)


@pytest.fixture
def bench() -> Bench:
    return Bench()


def twist(*components: float) -> bytes:
    return b"\0\1\0\0" + struct.pack("<6d", *components)


def imu(stamp: int) -> Imu:
    return Imu(stamp, "imu_link", (0.0, 0.0, 0.6, 0.8), (1.0, 2.0, 3.0), (4.0, 5.0, 6.0), 7, 8, 9)


def test_every_stream_is_known_by_key() -> None:
    streams = outgoing(load(SHIPPED / "indoor_lab.yaml"), RUN)
    assert [(s.key, s.topic, s.msg_type, s.declared_hz) for s in streams] == [
        ("groundlink/lab/clock", "/clock", 8, 100.0),
        ("groundlink/lab/rover/lidar", "/points", 1, 10.0),
        ("groundlink/lab/rover/imu", "/imu", 2, 400.0),
        ("groundlink/lab/rover/encoders", "/wheel_encoders", 5, 50.0),
    ]


def test_an_imu_sample_becomes_a_ros_message(bench: Bench) -> None:
    bench.forward("rover/imu", imu(3_000_000_007))
    (sent,) = bench.link.sent
    assert (sent["msg_type"], sent["topic"], sent["link"]) == (2, "/imu", "imu_link")
    assert (sent["stamp"], sent["to"]) == (3_000_000_007, PEER)
    message: Any = STORE.deserialize_cdr(sent["body"], "sensor_msgs/msg/Imu")
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (3, 7)
    assert message.header.frame_id == "imu_link"
    assert (message.orientation.z, message.orientation.w) == (0.6, 0.8)
    assert message.linear_acceleration.z == 6.0
    assert message.angular_velocity_covariance.tolist() == [8, 0, 0, 0, 8, 0, 0, 0, 8]


def test_a_cloud_becomes_a_ros_message(bench: Bench) -> None:
    points = np.zeros(3, POINT)
    points["x"], points["ring"], points["time"] = [1, 2, 3], [0, 7, 15], [0, 0.05, 0.1]
    bench.forward("rover/lidar", PointCloud(1, "lidar_link", packed(points)))
    cloud: Any = STORE.deserialize_cdr(bench.link.sent[0]["body"], "sensor_msgs/msg/PointCloud2")
    assert (cloud.height, cloud.width, cloud.point_step, cloud.row_step) == (1, 3, 22, 66)
    assert [(f.name, f.offset, f.datatype) for f in cloud.fields] == [
        ("x", 0, 7),
        ("y", 4, 7),
        ("z", 8, 7),
        ("intensity", 12, 7),
        ("ring", 16, 4),
        ("time", 18, 7),
    ]
    assert cloud.is_dense
    assert cloud.data.tobytes() == points.tobytes()


def test_encoder_counts_become_a_ros_message(bench: Bench) -> None:
    reading = WheelEncoders(2, "base_link", ("left", "right"), (-(2**62), 2**62))
    bench.forward("rover/encoders", reading)
    body = bench.link.sent[0]["body"]
    message: Any = STORE.deserialize_cdr(body, "groundlink_msgs/msg/WheelEncoders")
    assert message.name == ["left", "right"]
    assert message.ticks.tolist() == [-(2**62), 2**62]


def test_transforms_and_wishes_are_repeated_once_time_is_known(bench: Bench) -> None:
    bench.gateway.repeat(bench.link)  # type: ignore[arg-type]
    assert bench.link.sent == []
    bench.forward("clock", Clock(10**9 + 5, 5, 400))
    bench.link.sent.clear()
    bench.gateway.repeat(bench.link)  # type: ignore[arg-type]
    wish, transforms = bench.link.sent
    assert (wish["stamp"], transforms["stamp"]) == (10**9 + 5, 5)
    assert (wish["msg_type"], wish["topic"]) == (SUBSCRIBE, "/cmd_vel")
    assert Subscribe.parse(wish["body"]) == Subscribe(TWIST, 1, 3, 0.0)
    assert (transforms["msg_type"], transforms["topic"]) == (TF_MESSAGE, "/tf_static")
    message: Any = STORE.deserialize_cdr(transforms["body"], "tf2_msgs/msg/TFMessage")
    frames = {t.child_frame_id: t.header.frame_id for t in message.transforms}
    assert frames == {"lidar_link": "base_link", "imu_link": "base_link"}


def test_a_twist_becomes_a_command_of_now(bench: Bench) -> None:
    bench.hear(TWIST, "/cmd_vel", twist(0.5, 0, 0, 0, 0, 0.25))
    assert bench.commands == [], "before the run's time is known nothing can be commanded"
    bench.forward("clock", Clock(10**9, 0, 400))
    bench.hear(TWIST, "/cmd_vel", twist(0.5, 0, 0, 0, 0, 0.25))
    command = Command(10**9, (0.5, 0.0, 0.0), (0.0, 0.0, 0.25))
    assert bench.commands == [("groundlink/lab/rover/command", command)]


@pytest.mark.parametrize(
    ("msg_type", "topic", "body"),
    [
        (TWIST, "/cmd_vel", b""),
        (TWIST, "/cmd_vel", b"\0\1\0\0abc"),
        (TWIST, "/cmd_vel", twist(math.nan, 0, 0, 0, 0, 0)),
        (TWIST, "/cmd_vel", twist(0, 0, 0, 0, 0, math.inf)),
        (TWIST, "/elsewhere", twist(1, 0, 0, 0, 0, 0)),
        (SUBSCRIBE, "/imu", b"short"),
        (SUBSCRIBE, "/nothing", Subscribe(2).pack()),
        (CONTROL, "/imu", b"\xff"),
        (2, "/imu", b"a reading on its way in"),
    ],
)
def test_what_makes_no_sense_is_counted(
    bench: Bench, msg_type: int, topic: str, body: bytes
) -> None:
    bench.forward("clock", Clock(10**9, 0, 400))
    bench.hear(msg_type, topic, body)
    assert bench.commands == []
    assert bench.gateway.report()[1]["refused"] == 1


def test_a_stranger_may_subscribe_but_not_report(bench: Bench) -> None:
    bench.hear(SUBSCRIBE, "/imu", Subscribe(2, lease_s=60).pack(), STRANGER)
    bench.forward("rover/imu", imu(1))
    assert [sent["to"] for sent in bench.link.sent] == [PEER, STRANGER]
    bench.hear(CONTROL, "/imu", TopicReport(2, 99, 0, 0, 0, 0, 0, 1, 0).pack(), STRANGER)
    assert all(row.messages == 0 for row in bench.gateway.report()[0])
    bench.hear(CONTROL, "/imu", TopicReport(2, 99, 0, 0, 0, 0, 0, 1, 0).pack())
    bench.hear(CONTROL, "", LinkReport(1, 2, 3, 4, 5).pack())
    streams, counters = bench.gateway.report()
    assert [row.messages for row in streams if row.topic == "/imu"] == [99]
    assert counters["peer_kernel_drops"] == 5


def test_repeated_stamps_are_dropped_and_jumps_back_in_time_are_not(bench: Bench) -> None:
    def stamps() -> list[int]:
        return [sent["stamp"] for sent in bench.link.sent if sent["topic"] == "/imu"]

    bench.forward("clock", Clock(10**10, 0, 4000))
    for stamp in (10**10, 10**10 + 5, 10**10, 10**10 + 5, 10**10 + 10):
        bench.forward("rover/imu", imu(stamp))
    assert stamps() == [10**10, 10**10 + 5, 10**10 + 10]
    assert bench.gateway.report()[1]["stale"] == 2
    bench.forward("clock", Clock(0, 0, 0))
    bench.forward("rover/imu", imu(5))
    assert stamps()[-1] == 5
