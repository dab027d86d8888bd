# SPDX-License-Identifier: Apache-2.0
"""The one table of how each kind of topic is delivered in ROS, with the reasons.

Rule: nobody is left out. A DDS writer that offers `reliable` serves reliable and best-effort
readers alike, one that offers best effort serves only the latter; a reader is the other way round.
So every publisher offers reliable: RViz and a plain ``create_subscription(..., 10)`` match, and
sensor-data readers get best effort as they asked. It never blocks, as only the last `depth`
messages are kept; all it costs is that a reliable reader which lags is sent those again.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any, NamedTuple

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy


class Delivery(NamedTuple):
    """How messages of one kind are published or subscribed to."""

    depth: int
    """Messages that DDS keeps for readers that lag."""
    waiting: int = 0
    """Messages that may wait for the publishing thread; a newer one drops the oldest."""
    waiting_bytes: int = 0
    """More may wait if they hold no more than this: a LiDAR's blocks come in bursts."""
    is_reliable: bool = True
    is_latched: bool = False
    """Transient local: a late reader gets the last ones. Sent again only when it changed."""

    def qos(self) -> QoSProfile:
        """Return this as rclpy wants it."""
        return QoSProfile(
            history=HistoryPolicy.KEEP_LAST,
            depth=self.depth,
            reliability=ReliabilityPolicy.RELIABLE
            if self.is_reliable
            else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL
            if self.is_latched
            else DurabilityPolicy.VOLATILE,
        )


# Half a second of an IMU at 400 Hz in DDS, and a second of it while the publishing thread is busy.
_SMALL = Delivery(depth=200, waiting=400)
# Megabytes each, and only the newest is worth its time.
_LARGE = Delivery(depth=5, waiting=3, waiting_bytes=1 << 20)

_PUBLISHED = {
    "PointCloud2": _LARGE,
    "Image": _LARGE,
    "CompressedImage": _LARGE,
    # Readers of use_sim_time keep one; a jump of a late reader through old times helps nobody.
    "Clock": Delivery(depth=1, waiting=10),
    # Each message moves other frames, so none may be dropped for a newer one lightly.
    "TFMessage": _SMALL,
}

_STATIC_TRANSFORMS = Delivery(depth=16, waiting=16, is_latched=True)
STATIC_TRANSFORMS_TOPIC = "tf_static"

_SUBSCRIBED = {
    # Maps are published once and latched; this only matches publishers that do so.
    "OccupancyGrid": Delivery(depth=1, is_latched=True),
}
# Best effort matches every publisher; on one host shared memory loses nothing of this size.
_STREAM = Delivery(depth=10, is_reliable=False)


def published(type_name: str, topic: str) -> Delivery:
    """Return how a message type of the wire is published on a topic."""
    if type_name == "TFMessage" and topic.rsplit("/", 1)[-1] == STATIC_TRANSFORMS_TOPIC:
        return _STATIC_TRANSFORMS
    return _PUBLISHED.get(type_name, _SMALL)


def subscribed(type_name: str) -> Delivery:
    """Return how a message type of the wire is subscribed to."""
    return _SUBSCRIBED.get(type_name, _STREAM)


def message_class(ros_type: str) -> Any:
    """Return the class of a ROS type such as ``sensor_msgs/msg/Imu``.

    Raises
    ------
    ImportError
        When its package is not installed.
    """
    package, kind, name = ros_type.split("/")
    return getattr(import_module(f"{package}.{kind}"), name)
