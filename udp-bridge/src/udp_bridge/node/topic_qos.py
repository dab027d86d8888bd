# SPDX-License-Identifier: Apache-2.0
"""The one table of how each kind of topic is published in ROS, with the reasons."""

from __future__ import annotations

from typing import NamedTuple


class TopicQos(NamedTuple):
    """How messages of one kind are published or subscribed to."""

    depth: int
    """Messages that ROS keeps for readers that lag."""
    waiting: int = 0
    """Messages that may wait for the publishing thread; a newer one drops the oldest."""
    waiting_bytes: int = 0
    """More may wait if they hold no more than this: a LiDAR's blocks come in bursts."""
    is_latched: bool = False
    """A late reader gets the last one, which is sent again only when it changed."""


# Half a second of an IMU at 400 Hz in ROS, and a second of it while the publishing thread is busy.
_SMALL = TopicQos(depth=200, waiting=400)
# Megabytes each, and only the newest is worth its time.
_LARGE = TopicQos(depth=5, waiting=3, waiting_bytes=1 << 20)

_PUBLISHED = {
    "PointCloud2": _LARGE,
    "Image": _LARGE,
    "CompressedImage": _LARGE,
    # Readers of use_sim_time keep one; a jump of a late reader through old times helps nobody.
    "Clock": TopicQos(depth=1, waiting=10),
    # Each message moves other frames, so none may be dropped for a newer one lightly.
    "TFMessage": _SMALL,
    # Messages of any size: half a second at 100 Hz, and no more than a few large ones.
    "Typed": TopicQos(depth=50, waiting=3, waiting_bytes=1 << 20),
}

_STATIC_TRANSFORMS = TopicQos(depth=16, waiting=16, is_latched=True)
STATIC_TRANSFORMS_TOPIC = "tf_static"
# A text is a robot's description; robot_state_publisher has it the same way.
_DESCRIPTION = TopicQos(depth=1, waiting=16, is_latched=True)


def published(type_name: str, topic: str) -> TopicQos:
    """Return how a message type of the wire is published on a topic."""
    if type_name == "TFMessage" and topic.rsplit("/", 1)[-1] == STATIC_TRANSFORMS_TOPIC:
        return _STATIC_TRANSFORMS
    if type_name == "String":
        return _DESCRIPTION
    return _PUBLISHED.get(type_name, _SMALL)
