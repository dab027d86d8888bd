# SPDX-License-Identifier: Apache-2.0
"""Raw subscriptions for ROS 2, which receive CDR."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from udp_bridge.node.message_class import message_class
from udp_bridge.node.subscriptions import Subscription

from . import qos as qos_profiles

if TYPE_CHECKING:
    from rclpy.node import Node

    from udp_bridge.wire.types import MessageType


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
        fields = ros_class.get_fields_and_field_types()
        made = self._node.create_subscription(
            ros_class,
            topic,
            take,
            qos_profiles.subscription_profile(row.name),
            raw=True,
            qos_overriding_options=qos_profiles.OVERRIDES,
        )
        return Subscription(
            fields.get("header") == "std_msgs/Header",
            lambda: self._node.destroy_subscription(made),
        )
