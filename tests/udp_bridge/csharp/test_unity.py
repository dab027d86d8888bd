# SPDX-License-Identifier: Apache-2.0
"""The Unity package: compiled against stubs of Unity's API, and played against a ROS node's end."""

import json
import subprocess
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from groundlink.messages.base import POINT
from groundlink.ros.types import STORE, TYPES
from tools.unity_metas import metas
from udp_bridge import Link, Message
from udp_bridge.wire.control import Subscribe
from udp_bridge.wire.types import SUBSCRIBE

from .programs import FOLDER, scene_beside

CLOUD, IMAGE, CLOCK, TWIST = 1, 3, 8, 9


@pytest.fixture(scope="module")
def scene(library: Path) -> Path:
    return scene_beside(library)


def test_each_asset_has_a_guid_of_its_own() -> None:
    """A copy of the package keeps them, and so the references of its users' scenes."""
    wanted = metas()
    assert {file: file.read_text(encoding="utf-8") for file in FOLDER.rglob("*.meta")} == wanted
    guids = {text.split("guid: ")[1][:32] for text in wanted.values()}
    assert len(guids) == len(wanted) > 70
    assert (
        "4bbeca889b161fcc6ff69badb56eb8b1" in wanted[FOLDER / "Runtime/Unity/LidarSender.cs.meta"]
    )


class RosSide:
    """The end of a ROS node, which answers the request of commands with one."""

    def __init__(self) -> None:
        self.messages: list[Message] = []
        self.link = Link(("127.0.0.1", 0), on_message=self._take, report=True)

    def _take(self, message: Message, sender: Any) -> None:
        self.messages.append(message)
        if len(self.of(SUBSCRIBE)) != 1 or message.msg_type != SUBSCRIBE:
            return
        assert Subscribe.parse(message.body) == Subscribe(TWIST, lease_s=10)
        vector, twist = (TYPES[f"geometry_msgs/msg/{name}"] for name in ("Vector3", "Twist"))
        for number, z in enumerate((float("nan"), 0.0)):
            command = twist(vector(1.5, 0.25, z), vector(0.0, 0.1, 0.75))
            body = STORE.serialize_cdr(command, "geometry_msgs/msg/Twist")
            self.link.send(TWIST, "/cmd_vel", "", time.time_ns() + number, body, sender)

    def of(self, kind: int) -> list[Message]:
        return [message for message in self.messages if message.msg_type == kind]


@pytest.fixture(scope="module")
def played(scene: Path) -> tuple[RosSide, list[list[str]]]:
    """What a ROS side received of the scene, and the lines that the scene printed."""
    ros = RosSide()
    command = ["mono", str(scene), str(ros.link.address[1])]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    errors = ros.link.counters()["errors"]
    ros.link.close()
    assert not errors
    assert done.returncode == 0, done.stdout + done.stderr
    return ros, [line.split() for line in done.stdout.splitlines()]


Played = tuple[RosSide, list[list[str]]]


def said(played: Played, word: str) -> list[list[str]]:
    return [rest for first, *rest in played[1] if first == word]


def read(message: Message, ros_type: str) -> Any:
    found = STORE.deserialize_cdr(bytes(message.body), ros_type)
    if hasattr(found, "header"):
        stamp = found.header.stamp
        assert stamp.sec * 10**9 + stamp.nanosec == message.stamp_nanos
        assert found.header.frame_id == message.link
    return found


def test_axes_are_mirrored(played: Played) -> None:
    """Ahead is z, left is -x, up is y; there and back nothing changes."""
    ahead, left, up = said(played, "axis")
    assert [[float(x) for x in axis] for axis in (ahead, left, up)] == [
        [0, 0, 1],
        [-1, 0, 0],
        [0, 1, 0],
    ]
    assert said(played, "same") == 3 * [["True", "True"]]
    assert said(played, "ahead") == [left]
    assert said(played, "quaternion") == [["0.000", "0.000", "0.707", "0.707"]]


def test_twist_is_handed_over_and_ends(played: Played) -> None:
    """A turn to the left, +z of ROS, is about -y of Unity. One with NaN is refused."""
    linear, angular = said(played, "linear"), said(played, "angular")
    assert [float(x) for x in linear[0]] == [-0.25, 0, 1.5]
    assert [float(x) for x in angular[0]] == [0.1, -0.75, 0]
    assert [float(x) for x in linear[1] + angular[1]] == 6 * [0]  # nothing followed for 0.5 s
    assert said(played, "invalid") == [["1"]]


def test_script_of_the_guide_drives_the_body(played: Played) -> None:
    """For half a second ahead and to the left, and turning to the left: +z of ROS."""
    x, y, z = (float(word) for word in said(played, "body")[0])
    assert np.hypot(x, z) == pytest.approx(0.5 * np.hypot(1.5, 0.25), rel=0.15)
    assert x < 0 < z
    assert y == pytest.approx(0, abs=0.1)  # it also pitches a little
    ahead = [float(word) for word in said(played, "heading")[0]]
    yaw = np.arctan2(-ahead[0], ahead[2])
    assert yaw == pytest.approx(0.5 * 0.75, rel=0.2)


def test_cloud_is_of_the_scene(played: Played) -> None:
    """The sensor stands 1 m above a floor and 10 m before a wall."""
    first = played[0].of(CLOUD)[0]
    assert (first.topic, first.link) == ("/points", "lidar_link")
    cloud = read(first, "sensor_msgs/msg/PointCloud2")
    names = [(field.name, field.offset, field.datatype) for field in cloud.fields]
    floats = [("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("intensity", 12, 7)]
    assert names == [*floats, ("ring", 16, 4), ("time", 18, 7)]
    assert (cloud.point_step, cloud.row_step) == (POINT.itemsize, POINT.itemsize * cloud.width)
    points = np.frombuffer(cloud.data, POINT)
    assert len(points) == cloud.width > 3000
    x, y, z = (points[name].astype(float) for name in "xyz")
    is_wall = np.abs(x - 10) < 1e-3
    np.testing.assert_allclose(z[~is_wall], -1, atol=1e-4)
    assert is_wall.any()
    assert not is_wall.all()
    distance = np.sqrt(x**2 + y**2 + z**2)
    cosine = np.where(is_wall, x, -z) / distance
    np.testing.assert_allclose(points["intensity"], 100 * cosine, rtol=1e-3)
    elevation = np.degrees(np.arcsin(z / distance))
    np.testing.assert_allclose(elevation, -15.0 + 2 * points["ring"], atol=1e-3)
    azimuth = np.degrees(np.arctan2(-y, x)) % 360  # clockwise seen from above
    np.testing.assert_allclose(azimuth % 359.99, points["time"] * 3600, atol=0.02)
    assert 0 <= points["time"].min() < points["time"].max() < 0.1


def test_clouds_and_images_have_their_rates_and_the_clock(played: Played) -> None:
    """A slow machine leaves some out: a newer one replaces what still waits."""
    ros, _ = played
    for kind in (CLOUD, IMAGE):
        stamps = [one.stamp_nanos for one in ros.of(kind)]
        turns = np.diff(stamps) / 1e8
        np.testing.assert_allclose(turns, turns.round(), atol=1e-4)
        assert turns.min() > 0.5
        assert len(stamps) > 3
    clock = [one.stamp_nanos for one in ros.of(CLOCK)]
    assert np.diff(clock).min() == pytest.approx(1e9 / 60, abs=1e3)
    for message in ros.of(CLOCK)[:5]:
        value = read(message, "rosgraph_msgs/msg/Clock").clock
        assert value.sec * 10**9 + value.nanosec == message.stamp_nanos


def test_image_is_what_the_camera_rendered(played: Played) -> None:
    first, *others = played[0].of(IMAGE)
    image = read(first, "sensor_msgs/msg/CompressedImage")
    assert (image.format, image.header.frame_id) == ("jpeg", "camera_optical_frame")
    assert len(image.data) == 100_000
    *sizes, begin = image.data[:16].view(np.int32).tolist()
    assert sizes == [640, 480, 85]
    for other in others:
        number = read(other, "sensor_msgs/msg/CompressedImage").data[12:16].view(np.int32)[0]
        assert number - begin == round((other.stamp_nanos - first.stamp_nanos) / 1e8)


def test_scene_knows_what_became_of_its_messages(played: Played) -> None:
    ros, _ = played
    deliveries = {row[0]: row[1:] for row in said(played, "deliveries")}
    assert deliveries.keys() == {"/points", "/camera/image_raw/compressed", "/clock"}
    for sent, delivered, others, is_sum in deliveries.values():
        assert is_sum == "True"
        assert int(others) == 0
        assert 0 < int(delivered) <= int(sent)
    ((datagrams, refused),) = said(played, "peer")
    assert int(datagrams) > 10
    assert refused == "0"
    assert not ros.link.received.refused


def test_package_names_its_parts() -> None:
    package = json.loads((FOLDER / "package.json").read_text())
    assert package["name"] == "org.groundlink.udp-bridge"
    library, unity = (
        json.loads((FOLDER / "Runtime" / path).read_text())
        for path in ("UdpBridge/UdpBridge.asmdef", "Unity/UdpBridge.Unity.asmdef")
    )
    assert library["noEngineReferences"] is True
    assert unity["references"] == [library["name"]]
