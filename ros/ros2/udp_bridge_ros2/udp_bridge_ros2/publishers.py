# SPDX-License-Identifier: Apache-2.0
"""Publishers for ROS 2, which publish CDR bytes unchanged."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rclpy.serialization import deserialize_message

from udp_bridge.node.message_class import message_class
from udp_bridge.node.options import prefix_frames
from udp_bridge.node.publish_queue import Publication

from . import qos as qos_profiles

if TYPE_CHECKING:
    from typing import Any

    from rclpy.node import Node

    from udp_bridge.node.topic_qos import TopicQos
    from udp_bridge.wire.header import Buffer
    from udp_bridge.wire.types import MessageType


class Ros2Publishers:
    """Factory of a node's publishers."""

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

        def publish(body: Buffer) -> None:
            publisher.publish(bytes(body))  # the only copy; rclpy accepts only bytes

        def publish_prefixed(body: Buffer) -> None:
            message = deserialize_message(bytes(body), ros_class)
            prefix_frames(message, self._frame_prefix)
            publisher.publish(message)

        return Publication(
            publish_prefixed if self._frame_prefix else publish,
            lambda: self._node.destroy_publisher(publisher),
        )
