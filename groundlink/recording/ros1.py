# SPDX-License-Identifier: Apache-2.0
"""Conversion of a recording to a ROS 1 bag: same topics and times, bodies in ROS 1 form.

Messages are converted one by one, so memory does not grow with the file. Definitions are those of
ROS Noetic, and fields added by ROS 2 are dropped. Types that Noetic lacks have their definitions of
ROS 2.
"""

from collections.abc import Iterable
from pathlib import Path

from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from groundlink.ros.base import is_latched
from groundlink.ros.types import (
    STORE,
    WHEEL_ENCODERS_DEFINITION,
    definition,
    register_unknown,
)

from .reader import RecordedMessage

NOETIC = get_typestore(Stores.ROS1_NOETIC)
register_unknown(
    {
        "groundlink_msgs/msg/WheelEncoders": WHEEL_ENCODERS_DEFINITION,
        "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms\n",
    },
    NOETIC,
)

_ADDED_BYTES = {"sensor_msgs/msg/Range": 4}
"""Bytes at the end of a type that ROS 1 lacks (the variance of Range)."""


def to_ros1(ros_type: str, cdr: bytes | memoryview) -> memoryview:
    """Return a ROS 2 message's CDR as a ROS 1 message; headers get the sequence number 0."""
    data = STORE.cdr_to_ros1(cdr, ros_type)
    return data[: len(data) - _ADDED_BYTES.get(ros_type, 0)]


def write_bag(path: Path, types: dict[str, str], messages: Iterable[RecordedMessage]) -> int:
    """Write a bag and return how many messages it holds.

    Parameters
    ----------
    types
        ROS type by topic.
    """
    count = 0
    register_unknown({ros_type: definition(ros_type) for ros_type in types.values()}, NOETIC)
    with Writer(path) as bag:
        connections = {}
        for topic, ros_type in types.items():
            text, digest = NOETIC.generate_msgdef(ros_type, ros_version=1)
            latching = int(is_latched(topic))
            connections[topic] = bag.add_connection(
                topic, ros_type, msgdef=text, md5sum=digest, latching=latching
            )
        for message in messages:
            data = to_ros1(message.ros_type, message.cdr)
            bag.write(connections[message.topic], message.nanos, data)
            count += 1
    return count
