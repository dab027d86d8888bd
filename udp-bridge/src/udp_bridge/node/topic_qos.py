# SPDX-License-Identifier: Apache-2.0
"""Publishing of each type in ROS: history depth, queue limits and latching, with the reasons."""

from __future__ import annotations

from typing import NamedTuple, Optional


class TopicQos(NamedTuple):
    """Quality of service of a topic, and limits of its publish queue."""

    depth: int
    """History depth: messages that ROS keeps for slow subscribers."""
    waiting: int = 0
    """Messages that may wait in the publish queue; a newer one drops the oldest."""
    waiting_bytes: int = 0
    """More messages may wait if they take no more than this: blocks of a LiDAR come in bursts."""
    is_latched: bool = False
    """A late subscriber gets the last message."""
    is_repeated: bool = False
    """The sender repeats the same message, which is published again only when it changes. In
    lockstep it is published when it arrives."""


# Half a second of an IMU at 400 Hz in ROS, and a second of it while the publishing thread is busy.
_SMALL = TopicQos(depth=200, waiting=400)
# Megabytes each; only the newest is worth publishing.
_LARGE = TopicQos(depth=5, waiting=3, waiting_bytes=1 << 20)

_PUBLISHED = {
    "PointCloud2": _LARGE,
    "Image": _LARGE,
    "CompressedImage": _LARGE,
    # Subscribers with use_sim_time keep one; old times are of no use to a late one.
    "Clock": TopicQos(depth=1, waiting=10),
    # Each message moves other frames, so a newer one does not replace it.
    "TFMessage": _SMALL,
    # As map_server publishes maps; subscribers of navigation match latched publishers only.
    "OccupancyGrid": TopicQos(depth=1, waiting=3, is_latched=True),
    # Messages of any size: half a second at 100 Hz, and no more than a few large ones.
    "Typed": TopicQos(depth=50, waiting=3, waiting_bytes=1 << 20),
}

QOS_BY_ROS_TYPE = {
    # Late subscribers need this table of names; vision_msgs recommends a latched topic.
    "vision_msgs/msg/LabelInfo": TopicQos(depth=1, waiting=3, is_latched=True),
}
"""Publishing of ROS types without a wire type of their own."""

_STATIC_TRANSFORMS = TopicQos(depth=16, waiting=16, is_latched=True, is_repeated=True)
STATIC_TRANSFORMS_TOPIC = "tf_static"
# A String is a robot description; robot_state_publisher latches it, too.
_DESCRIPTION = TopicQos(depth=1, waiting=16, is_latched=True, is_repeated=True)


def publisher_qos(type_name: str, topic: str, ros_type: Optional[str] = None) -> TopicQos:
    """Return how a wire type, or a ROS type without one, is published on a topic."""
    if type_name == "TFMessage" and topic.rsplit("/", 1)[-1] == STATIC_TRANSFORMS_TOPIC:
        return _STATIC_TRANSFORMS
    if type_name == "String":
        return _DESCRIPTION
    return QOS_BY_ROS_TYPE.get(ros_type or "") or _PUBLISHED.get(type_name, _SMALL)
