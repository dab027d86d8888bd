# SPDX-License-Identifier: Apache-2.0
"""Topics of ROS 2: publishers and raw subscriptions of CDR bytes, and the graph."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from functools import partial
from typing import TYPE_CHECKING, Any

from rclpy.serialization import deserialize_message

from udp_bridge.node.message_class import message_class
from udp_bridge.node.options import prefix_frames
from udp_bridge.node.publish_queue import Publication
from udp_bridge.node.subscriptions import RosSample, Subscription, stamped_sample

from . import qos as qos_profiles
from .serialized import serialized_publish

if TYPE_CHECKING:
    from rclpy.node import Node

    from udp_bridge.node.topic_qos import TopicQos
    from udp_bridge.wire.header import Buffer
    from udp_bridge.wire.types import MessageType


class Ros2Publishers:
    """Factory of a node's publishers, which publish CDR bytes unchanged."""

    def __init__(self, node: Node, frame_prefix: str = "") -> None:
        self._node = node
        self._frame_prefix = frame_prefix

    def get_logger(self) -> Any:
        """Return the node's logger."""
        return self._node.get_logger()

    def publisher(self, row: MessageType, topic: str, qos: TopicQos) -> Publication:
        """Return a publisher of a topic."""
        assert row.ros_type is not None
        ros_class = message_class(row.ros_type)
        publisher = self._node.create_publisher(
            ros_class,
            topic,
            qos_profiles.publisher_profile(qos),
            qos_overriding_options=qos_profiles.OVERRIDES,
        )

        def publish_prefixed(body: Buffer) -> None:
            message = deserialize_message(bytes(body), ros_class)
            prefix_frames(message, self._frame_prefix)
            publisher.publish(message)

        return Publication(
            publish_prefixed if self._frame_prefix else serialized_publish(publisher),
            lambda: self._node.destroy_publisher(publisher),
        )


class Ros2Subscriptions:
    """Factory of a node's subscriptions; callbacks run in the thread that spins the node."""

    def __init__(self, node: Node) -> None:
        self._node = node

    def get_logger(self) -> Any:
        """Return the node's logger."""
        return self._node.get_logger()

    def now_nanos(self) -> int:
        """Return the node's time in nanoseconds."""
        return int(self._node.get_clock().now().nanoseconds)

    def type_of(self, topic: str) -> str:
        """Return the full type name of a published topic; empty without a publisher."""
        found = self._node.get_publishers_info_by_topic(topic)
        return str(found[0].topic_type) if found else ""

    def subscribe(
        self, row: MessageType, topic: str, take: Callable[[bytes], None]
    ) -> Subscription:
        """Call `take` with the body of each message."""
        ros_class = message_class(str(row.ros_type))
        made = self._node.create_subscription(
            ros_class,
            topic,
            take,
            qos_profiles.subscription_profile(row.name),
            raw=True,
            qos_overriding_options=qos_profiles.OVERRIDES,
        )
        return Subscription(
            is_stamped(ros_class),
            lambda: self._node.destroy_subscription(made),
        )


class Ros2Graph:
    """Graph as a node sees it (`udp_bridge.node.responses.RosGraph`).

    Use it only in the thread that spins the node.
    """

    def __init__(self, node: Node) -> None:
        self._node = node

    def publishers(self, topic: str) -> frozenset[Hashable]:
        """Return identities of a topic's publishers; a restarted publisher has a new one."""
        found = self._node.get_publishers_info_by_topic(topic)
        return frozenset(bytes(info.endpoint_gid) for info in found)

    def has_publisher(self, topic: str) -> bool:
        """Return whether a topic has a publisher."""
        return bool(self._node.count_publishers(topic))

    def has_subscriber(self, topic: str, is_own: bool) -> bool:
        """Return whether a topic has a subscriber, besides the bridge itself if `is_own`."""
        return bool(self._node.count_subscribers(topic) > is_own)

    def listen(self, topic: str, take: Callable[[RosSample], object]) -> object:
        """Subscribe to a topic of any type, as soon as its type is known."""
        for info in self._node.get_publishers_info_by_topic(topic):
            ros_class = message_class(info.topic_type)
            return self._node.create_subscription(
                ros_class,
                topic,
                partial(_take, take, info.topic_type, is_stamped(ros_class)),
                qos_profiles.listening_profile(info.qos_profile.reliability),
                raw=True,
            )
        return None


def is_stamped(ros_class: Any) -> bool:
    """Return whether messages of a class begin with a std_msgs/Header."""
    return bool(ros_class.get_fields_and_field_types().get("header") == "std_msgs/Header")


def _take(
    take: Callable[[RosSample], object], ros_type: str, has_header: bool, body: bytes
) -> None:
    sample = stamped_sample(body, ros_type) if has_header else None
    take(sample or RosSample("", None, body, ros_type))
