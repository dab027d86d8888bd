# SPDX-License-Identifier: Apache-2.0
"""Every type of a recording as ROS 1 has it."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Reader

from groundlink.recording.reader import RecordedMessage
from groundlink.recording.ros1 import NOETIC, to_ros1, write_bag
from groundlink.ros.cdr import CODECS, ROS_CODECS, to_cdr
from groundlink.ros.types import STORE
from tests.vectors.examples import EXAMPLES

KNOWN_DIGESTS = {
    "sensor_msgs/msg/Imu": "6a62c6daae103f4ff57a132d6f95cec2",
    "sensor_msgs/msg/PointCloud2": "1158d486dd51d683ce2f1be655c3c181",
    "tf2_msgs/msg/TFMessage": "94810edda583a504dfda3829e70d7eec",
    "sensor_msgs/msg/Range": "c005c34273dc426c67a020a87bc24148",
    "sensor_msgs/msg/CameraInfo": "c9a58c1b0b154e0e6da7578cb991d214",
}
"""As `rosmsg md5` says them in Noetic."""


def same(ros1: Any, ros2: Any) -> bool:
    """Compare field by field, by the names of ROS 2; what ROS 1 lacks does not count."""
    if isinstance(ros2, np.ndarray):
        return bool(np.array_equal(ros1, ros2))
    if isinstance(ros2, list):
        return len(ros1) == len(ros2) and all(map(same, ros1, ros2))
    if not hasattr(ros2, "__dataclass_fields__"):
        return bool(ros1 == ros2)
    of_ros1 = {name.lower().strip("_"): name for name in ros1.__dataclass_fields__}
    fields = {name for name, _ in STORE.fielddefs[ros2.__msgtype__][1]}
    lacking = {name for name in fields if name.lower().strip("_") not in of_ros1}
    assert lacking == ({"variance"} if ros2.__msgtype__ == "sensor_msgs/msg/Range" else set())
    return all(
        same(getattr(ros1, of_ros1[name.lower().strip("_")]), getattr(ros2, name))
        for name in fields - lacking
    )


@pytest.mark.parametrize("name", EXAMPLES)
def test_fields_are_the_same(name: str) -> None:
    message = EXAMPLES[name].message
    ros_type = ROS_CODECS[type(message)].ros_type
    cdr = to_cdr(message)
    ros1 = NOETIC.deserialize_ros1(to_ros1(ros_type, cdr), ros_type)
    assert same(ros1, STORE.deserialize_cdr(cdr, ros_type))


@pytest.mark.parametrize("ros_type", KNOWN_DIGESTS)
def test_definitions_are_those_of_noetic(ros_type: str) -> None:
    assert NOETIC.generate_msgdef(ros_type, ros_version=1)[1] == KNOWN_DIGESTS[ros_type]


def test_a_bag_can_have_every_type(tmp_path: Path) -> None:
    every = {form.ros_type for form in CODECS.values()}
    types = {f"/topic_{number}": ros_type for number, ros_type in enumerate(sorted(every))}
    assert write_bag(tmp_path / "every.bag", types, []) == 0
    assert every <= NOETIC.types.keys()


def test_bag_has_topics_times_and_latched_messages(tmp_path: Path) -> None:
    cdr = bytes(to_cdr(EXAMPLES["transforms"].message))
    kind = "tf2_msgs/msg/TFMessage"
    messages = [RecordedMessage(5, "/tf_static", kind, cdr), RecordedMessage(9, "/tf", kind, cdr)]
    types = {"/tf_static": kind, "/tf": kind, "/imu": "sensor_msgs/msg/Imu"}
    assert write_bag(tmp_path / "a.bag", types, messages) == 2
    with Reader(tmp_path / "a.bag") as bag:
        found = [(connection.topic, nanos) for connection, nanos, _ in bag.messages()]
        latched = {c.topic: c.ext.latching for c in bag.connections}  # type: ignore[union-attr]
    assert found == [("/tf_static", 5), ("/tf", 9)]
    assert latched == {"/tf_static": 1, "/tf": 0, "/imu": 0}
