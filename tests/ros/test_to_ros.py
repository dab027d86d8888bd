# SPDX-License-Identifier: Apache-2.0
"""What a gateway sends arrives in ROS: real sockets, the real node, subscribers of their own."""

import zlib
from random import Random
from typing import Any

import pytest

from udp_bridge import Link, Message

from . import bodies
from .conftest import LATCHED, RELIABLE, SENSOR_DATA, FarEnd, Ros
from .processes import Process
from .waiting import each_period, wait_until

POINTS = 57_600
NANOS = bodies.NANOS
MILLISECOND = 1_000_000
CLOUD = "sensor_msgs/msg/PointCloud2"
IMU = "sensor_msgs/msg/Imu"
TF = "tf2_msgs/msg/TFMessage"


def since_start(listener: Process, topic: str) -> list[tuple[int, Any]]:
    """Return what came after the messages of stamp 0, which only made sure of the connection."""
    return [row for row in listener.messages(topic) if row[0] > 0]


@pytest.mark.parametrize("how", [SENSOR_DATA, RELIABLE], ids=["best effort", "reliable"])
def test_large_clouds_and_fast_readings_arrive_complete(
    ros: Ros, bridge: FarEnd, how: tuple[str, str, int, float]
) -> None:
    listener = ros.listen((CLOUD, "/points", how), (IMU, "/imu", how))
    bridge.reach(listener, 2, "/imu", bodies.imu(0))
    bridge.reach(listener, 1, "/points", bodies.cloud(0, b""))
    data = Random(1).randbytes(POINTS * bodies.POINT_BYTES)
    stamps = [NANOS + number * 5 * MILLISECOND // 2 for number in range(1200)]
    for number in each_period(0.0025, len(stamps)):
        stamp = stamps[number]
        bridge.send(2, "/imu", stamp, bodies.imu(stamp, x=float(number)), "imu")
        if number % 40 == 0:
            bridge.send(1, "/points", stamp, bodies.cloud(stamp, data), "lidar")
    listener.wait_for_stamp("/imu", stamps[-1])
    listener.wait_for_stamp("/points", stamps[-40])
    assert since_start(listener, "/imu") == [(stamp, n) for n, stamp in enumerate(stamps)]
    clouds = since_start(listener, "/points")
    assert [(stamp, content[:2]) for stamp, content in clouds] == [
        (stamp, [zlib.crc32(data), "lidar"]) for stamp in stamps[::40]
    ]


def test_encoders_and_clock(ros: Ros, bridge: FarEnd) -> None:
    listener = ros.listen(
        ("groundlink_msgs/msg/WheelEncoders", "/wheels", RELIABLE),
        ("rosgraph_msgs/msg/Clock", "/clock", ("BEST_EFFORT", "VOLATILE", 1, 0.0)),
    )
    bridge.reach(listener, 8, "/clock", bodies.clock(0))
    bridge.reach(listener, 5, "/wheels", bodies.wheels(0, [], []))
    names, ticks = ["front_left", "front_right"], [1 << 40, -(1 << 40)]
    bridge.send(5, "", 5 * NANOS, bodies.wheels(5 * NANOS, names, ticks), "base_link")
    bridge.send(8, "", 7 * NANOS + 1, bodies.clock(7 * NANOS + 1))
    listener.wait_for_stamp("/clock", 7 * NANOS + 1)
    listener.wait_for_stamp("/wheels", 5 * NANOS)
    assert since_start(listener, "/wheels") == [(5 * NANOS, [names, ticks])]


def test_static_transforms_are_latched_and_sent_again_only_when_changed(
    ros: Ros, bridge: FarEnd
) -> None:
    early = ros.listen((TF, "/tf_static", LATCHED), (IMU, "/imu", RELIABLE))
    first = bodies.transforms(NANOS, {"lidar": 0.25, "imu": -0.5})
    for _ in range(4):
        bridge.send(35, "/tf_static", NANOS, first)
    early.wait_for_stamp("/tf_static", NANOS)

    late = ros.listen((TF, "/tf_static", LATCHED))
    late.wait_for_stamp("/tf_static", NANOS)
    assert late.messages("/tf_static") == [(NANOS, {"lidar": 0.25, "imu": -0.5})]

    bridge.send(35, "/tf_static", 2 * NANOS, bodies.transforms(2 * NANOS, {"lidar": 1.0}))
    early.wait_for_stamp("/tf_static", 2 * NANOS)
    assert [stamp for stamp, _ in early.messages("/tf_static")] == [NANOS, 2 * NANOS]


def test_moving_transforms_are_all_sent(ros: Ros, bridge: FarEnd) -> None:
    listener = ros.listen((TF, "/tf", RELIABLE))
    bridge.reach(listener, 35, "/tf", bodies.transforms(0, {"base_link": 0.0}))
    for number in range(1, 51):
        # The same body twice is two messages: a standing vehicle is news, too.
        bridge.send(35, "/tf", number, bodies.transforms((number + 1) // 2, {"base_link": 1.0}))
    bridge.send(35, "/tf", 26, bodies.transforms(26, {"base_link": 1.0}))
    listener.wait_for_stamp("/tf", 26)
    stamps = [stamp for stamp, _ in since_start(listener, "/tf")]
    assert stamps == [*((number + 1) // 2 for number in range(1, 51)), 26]


def test_a_subscriber_that_sleeps_loses_its_own_and_can_count_it(ros: Ros, bridge: FarEnd) -> None:
    """Others get all. DDS tells no publisher what a reader's queue pushed out, but numbers them."""
    stalled = ros.listen(
        (CLOUD, "/points", ("RELIABLE", "VOLATILE", 5, 5.0)), (IMU, "/imu", RELIABLE)
    )
    listener = ros.listen(
        *((IMU, "/imu", SENSOR_DATA), (CLOUD, "/points", SENSOR_DATA)),
        ("diagnostic_msgs/msg/DiagnosticArray", "/diagnostics", RELIABLE),
    )
    bridge.reach(stalled, 1, "/points", bodies.cloud(0, b""))
    bridge.reach(listener, 1, "/points", bodies.cloud(0, b""))
    bridge.reach(listener, 2, "/imu", bodies.imu(0))
    data = bytes(POINTS * bodies.POINT_BYTES)
    stamps = range(NANOS, 2 * NANOS + 1, 5 * MILLISECOND // 2)
    for number in each_period(0.0025, len(stamps)):
        bridge.send(2, "/imu", stamps[number], bodies.imu(stamps[number]), "imu")
        if number % 10 == 0:
            bridge.send(1, "/points", stamps[number], bodies.cloud(stamps[number], data), "lidar")
    listener.wait_for_stamp("/imu", stamps[-1])
    listener.wait_for_stamp("/points", stamps[-1])
    assert [stamp for stamp, _ in since_start(listener, "/imu")] == list(stamps)
    assert [stamp for stamp, _ in since_start(listener, "/points")] == list(stamps[::10])
    stalled.wait_for_stamp("/points", stamps[-1])
    stalled.wait_for_stamp("/imu", stamps[-1])
    assert [stamp for stamp, _ in since_start(stalled, "/imu")] == list(stamps)
    numbers = [number for number, _ in stalled.messages("/points numbers")]
    lost = numbers[-1] - numbers[0] + 1 - len(numbers)
    assert len(since_start(stalled, "/points")) + lost == len(stamps[::10])
    assert lost > 0

    def told() -> dict[str, str]:
        rows = listener.messages("/diagnostics")
        return dict(dict(rows[-1][1])["udp_bridge: /points"][2]) if rows else {}

    listener.wait_until(lambda: told().get("delivered") == str(numbers[-1]), "that all went out")
    assert (told()["dropped"], told()["missing"]) == ("0", "0")


def test_what_ros_can_not_take_is_refused_and_the_rest_goes_on(ros: Ros) -> None:
    process, address = ros.bridge()
    far_end = FarEnd(address)
    listener = ros.listen((IMU, "/imu", RELIABLE))
    far_end.reach(listener, 2, "/imu", bodies.imu(0))
    for _ in range(3):
        far_end.send(2, "/no topic", NANOS, bodies.imu(NANOS))
        far_end.send(2, "/imu", NANOS, b"no CDR at all")
    far_end.send(2, "/imu", 2 * NANOS, bodies.imu(2 * NANOS))
    listener.wait_for_stamp("/imu", 2 * NANOS)
    far_end.close()
    process.end()
    assert len(since_start(listener, "/imu")) == 1
    assert process.output.count("/no topic: sensor_msgs/msg/Imu can't be published: ") == 1
    assert " messages published on 1 topics" in process.output
    assert process.output.endswith("refused 6")


def test_only_the_peer_is_listened_to(ros: Ros) -> None:
    heard: list[Message] = []
    with Link(("127.0.0.1", 0), on_message=lambda got, _: heard.append(got)) as peer:
        name = f"localhost:{peer.address[1]}"
        process, address = ros.bridge("--ros-args", "-p", f"peer:={name}")
        stranger = FarEnd(address)
        stranger.send(2, "/imu", NANOS, bodies.imu(NANOS))
        peer.send(2, "/imu", "", NANOS, bodies.imu(NANOS), address)
        wait_until(lambda: heard, "a report")  # what the stranger sent came before
        assert not stranger.of_type(64)
        stranger.close()
        process.end()
    assert process.output.endswith("refused 1")


def test_first_arrivals_are_logged(ros: Ros) -> None:
    process, address = ros.bridge()
    far_end = FarEnd(address)
    for _ in range(3):
        far_end.send(2, "/rover/imu", NANOS, bodies.imu(NANOS), "rover/imu")
    process.wait_for(r"/rover/imu: sensor_msgs/msg/Imu from 127.0.0.1:\d+, frame rover/imu")
    far_end.close()
    process.end()
    assert process.output.count("/rover/imu: ") == 1
