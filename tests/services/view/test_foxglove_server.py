# SPDX-License-Identifier: Apache-2.0
"""What a Foxglove client gets: ROS 2 topics that it can read by what is advertised alone."""

import socket
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.core.errors import UserError
from groundlink.messages.base import POINT, Clock, PointCloud, packed
from groundlink.messages.navigation import OccupancyGrid, Odometry
from groundlink.ros.cdr import to_cdr
from groundlink.ros.streams import actor_transforms
from services.view.foxglove_scene import scene
from services.view.foxglove_server import FoxgloveServer
from services.view.viewer_subscriptions import streams_of
from tests.system.rig import free_port

from .foxglove_client import Client, joined
from .scenes import EPOCH, SCENARIO, WITH_CRATE, state

STREAMS = streams_of(SCENARIO, "run")
UP = (0.0, 0.0, 0.0, 1.0)
NO_ERROR = memoryview(bytes(36 * 8))
CLOUD = PointCloud(EPOCH + 5, "lidar_link", packed(np.array([(1, 2, 3, 80, 4, 0.01)], POINT)))
TRUTH = Odometry(
    *(EPOCH + 7, "world", "base_link", (1.0, 2.0, 0.2), UP),
    *((1.0, 0.0, 0.0), (0.0, 0.0, 0.5), NO_ERROR, NO_ERROR),
)
GRID = OccupancyGrid(EPOCH, "map", EPOCH, 0.05, 1, 1, (0, 0, 0), UP, memoryview(b"\x64"))


@pytest.fixture
def served() -> Iterator[tuple[FoxgloveServer, Client]]:
    port = free_port(socket.SOCK_STREAM)
    server = FoxgloveServer(SCENARIO, "run", STREAMS, "127.0.0.1", port)
    server.take_states([state(0)])
    try:
        with joined(port) as client:
            yield server, client
    finally:
        server.close()


def say(server: FoxgloveServer, client: Client, what: dict[str, Any], wanted: int) -> None:
    """Have the server say something again until the client, newly subscribed, has got it."""
    deadline = time.monotonic() + 10
    while len(client.got) < wanted:
        assert time.monotonic() < deadline, client.got
        for path, message in what.items():
            server.take(path, STREAMS[path], message)
        server.flush()
        client.read(0.05)


def test_topics_are_those_of_ros_with_whole_definitions(
    served: tuple[FoxgloveServer, Client],
) -> None:
    _, client = served
    kinds = {topic: c["schemaName"] for topic, c in client.channels.items()}
    assert kinds == {
        "/clock": "rosgraph_msgs/msg/Clock",
        "/points": "sensor_msgs/msg/PointCloud2",
        "/camera/image_raw/compressed": "sensor_msgs/msg/CompressedImage",
        "/camera/camera_info": "sensor_msgs/msg/CameraInfo",
        "/imu": "sensor_msgs/msg/Imu",
        "/wheel_encoders": "groundlink_msgs/msg/WheelEncoders",
        "/ground_truth/odom": "nav_msgs/msg/Odometry",
        "/ground_truth/wheels": "sensor_msgs/msg/JointState",
        "/ground_truth/bodies": "tf2_msgs/msg/TFMessage",
        "/cmd_vel": "geometry_msgs/msg/Twist",
        "/pose": "geometry_msgs/msg/PoseStamped",
        "/map": "nav_msgs/msg/OccupancyGrid",
        "/ground_truth/tf": "tf2_msgs/msg/TFMessage",
        "/joint_states": "sensor_msgs/msg/JointState",
        "/robot_description": "std_msgs/msg/String",
        "/tf_static": "tf2_msgs/msg/TFMessage",
        "/scene": "foxglove.SceneUpdate",
    }
    del client.channels["/scene"]
    assert {c["encoding"] for c in client.channels.values()} == {"cdr"}
    assert {c["schemaEncoding"] for c in client.channels.values()} == {"ros2msg"}


def test_bytes_are_those_that_ros_gets(served: tuple[FoxgloveServer, Client]) -> None:
    server, client = served
    client.subscribe("/points")
    say(server, client, {"rover/lidar": CLOUD}, 1)
    assert client.got[0] == ("/points", CLOUD.stamp_nanos, bytes(to_cdr(CLOUD)))
    cloud = client.decoded("/points")
    assert (cloud.width, cloud.point_step, cloud.header.frame_id) == (1, 22, "lidar_link")


def test_what_nobody_wants_is_not_sent(served: tuple[FoxgloveServer, Client]) -> None:
    server, client = served
    client.subscribe("/points")
    say(server, client, {"rover/lidar": CLOUD, "rover/ground_truth": TRUTH}, 1)
    assert {topic for topic, _, _ in client.got} == {"/points"}


def test_the_tree_is_where_it_truly_is(served: tuple[FoxgloveServer, Client]) -> None:
    server, client = served
    client.subscribe("/ground_truth/tf")
    say(server, client, {"rover/ground_truth": TRUTH}, 1)
    (transform,) = client.decoded("/ground_truth/tf").transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ("world", "base_link")
    assert transform.transform.translation.y == 2.0


def test_what_seldom_changes_is_told_to_each_who_comes(
    served: tuple[FoxgloveServer, Client],
) -> None:
    server, client = served
    server.take("rover/from_ros/map", STREAMS["rover/from_ros/map"], GRID)
    topics = ("/tf_static", "/scene", "/map")
    client.subscribe(*topics)
    say(server, client, {}, 3)
    assert {topic for topic, _, _ in client.got} == set(topics)
    children = {t.child_frame_id for t in client.decoded("/tf_static").transforms}
    assert children == {"lidar_link", "imu_link", "camera_optical_frame"}
    with joined(server.port) as again:
        again.subscribe(*topics)
        say(server, again, {}, 3)


def test_the_clock_is_the_servers_time(served: tuple[FoxgloveServer, Client]) -> None:
    server, client = served
    server.take("clock", STREAMS["clock"], Clock(EPOCH + 10**9, EPOCH, 400, EPOCH))
    client.read()
    assert client.times == [EPOCH + 10**9]


def test_the_scene_has_the_room_without_its_ceiling(served: tuple[FoxgloveServer, Client]) -> None:
    server, client = served
    client.subscribe("/scene")
    say(server, client, {}, 1)
    body = client.got[0][2]
    assert b"world" in body
    assert b"base_link" in body
    assert len(body) > 10_000


def test_an_address_in_use_is_the_users_to_mend(served: tuple[FoxgloveServer, Client]) -> None:
    server, _ = served
    with pytest.raises(UserError, match=r"cannot serve on 127.0.0.1:\d+: .*--port"):
        FoxgloveServer(SCENARIO, "run", STREAMS, "127.0.0.1", server.port)


def test_actors_are_in_the_scene_and_on_tf() -> None:
    assert b"crate" in scene(WITH_CRATE, 0).encode()
    assert b"crate" not in scene(SCENARIO, 0).encode()
    told = replace(state(0), actors=packed(np.array([1.0, 2.0, 0.5, *UP])))
    (transform,) = actor_transforms(WITH_CRATE, told).transforms
    assert (transform.parent, transform.child) == ("world", "crate")
    assert (transform.translation_m, transform.rotation) == ((1.0, 2.0, 0.5), UP)
