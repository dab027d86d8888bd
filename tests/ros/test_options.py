# SPDX-License-Identifier: Apache-2.0
"""What a user can tell a node: as text, and what a real node makes of it."""

from typing import Any

import pytest

from udp_bridge.node.options import parse_datagram, parse_repair
from udp_bridge.sender.repair import Fec, Resend

from .bodies import cloud, imu, transforms
from .conftest import RELIABLE, SENSOR_DATA, FarEnd, Ros

CLOUD, IMU, TF = 1, 2, 35


@pytest.mark.parametrize(
    ("text", "means"),
    [
        ("none", None),
        ("resend", Resend(500_000_000)),
        ("resend 0.25", Resend(250_000_000)),
        ("fec 0.2", Fec(0.2)),
    ],
)
def test_repair(text: str, means: Any) -> None:
    assert parse_repair(text) == means


@pytest.mark.parametrize(("text", "size"), [("mtu", "mtu"), ("loopback", "loopback"), ("900", 900)])
def test_datagram(text: str, size: Any) -> None:
    assert parse_datagram(text) == size


@pytest.mark.parametrize("text", ["", "resend x", "fec", "fec 7", "again 1"])
def test_invalid_repair_gives_one_line(text: str) -> None:
    with pytest.raises(ValueError, match="expected none, resend"):
        parse_repair(text)


@pytest.mark.parametrize("text", ["", "jumbo", "12", "70000", "-1"])
def test_invalid_datagram_size_gives_one_line(text: str) -> None:
    with pytest.raises(ValueError, match="neither mtu, loopback nor"):
        parse_datagram(text)


def test_frames_and_qos_are_as_the_user_says(ros: Ros) -> None:
    process, address = ros.bridge(
        *("--ros-args", "-p", "frame_prefix:=one/", "-p", "datagram:=1400"),
        *("-p", "qos_overrides./imu.publisher.reliability:=best_effort", "-p", "repair:=resend"),
    )
    bridge = FarEnd(address)
    everybody = ros.listen(
        ("sensor_msgs/msg/PointCloud2", "/points", RELIABLE),
        ("sensor_msgs/msg/Imu", "/imu", SENSOR_DATA),
        ("tf2_msgs/msg/TFMessage", "/tf", RELIABLE),
    )
    picky = ros.listen(("sensor_msgs/msg/Imu", "/imu", RELIABLE))
    bridge.reach(everybody, CLOUD, "/points", cloud(5, bytes(range(22))))
    bridge.reach(everybody, TF, "/tf", transforms(7, {"lidar": 1.5}))
    bridge.reach(everybody, IMU, "/imu", imu(9))
    assert everybody.messages("/points")[0][1][1] == "one/lidar"
    assert everybody.messages("/tf")[0] == (7, {"one/lidar": 1.5})
    assert picky.messages("/imu") == []
    bridge.close()
    assert process.end() == 0


@pytest.mark.parametrize(
    ("option", "complaint"),
    [("repair:=again", "repair is 'again'"), ("datagram:=12", "datagram size 12 is neither")],
)
def test_mistakes_are_one_line(ros: Ros, option: str, complaint: str) -> None:
    process = ros.start("-m", "udp_bridge_ros2", "--ros-args", "-p", option)
    assert process.exit_code() == 2
    assert len(process.lines) == 1
    assert complaint in process.output
