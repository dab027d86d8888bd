# SPDX-License-Identifier: Apache-2.0
"""The outlet as ROS 2 fills it: publishers that take CDR bytes as they are."""

from __future__ import annotations

from typing import TYPE_CHECKING

from udp_bridge.ros_end import outlet

from . import topics

if TYPE_CHECKING:
    from typing import Any

    from rclpy.node import Node

    from udp_bridge.header import Buffer
    from udp_bridge.ros_end.deliveries import Delivery
    from udp_bridge.types import MessageType


class _Publishers:
    """Publishers of a node; its logger tells of them."""

    def __init__(self, node: Node) -> None:
        self._node = node

    def get_logger(self) -> Any:
        return self._node.get_logger()

    def publisher(self, row: MessageType, topic: str, delivery: Delivery) -> outlet.Publish:
        assert row.ros_type is not None
        publisher = self._node.create_publisher(
            topics.message_class(row.ros_type), topic, topics.published(delivery)
        )

        def publish(body: Buffer) -> None:
            publisher.publish(bytes(body))  # the one copy: rclpy takes nothing but bytes

        return publish


class Outlet(outlet.Outlet):
    """Publishes messages on a thread of its own, by the publishers of a node."""

    def __init__(self, node: Node, on_fate: outlet.OnFate = lambda *_: None) -> None:
        super().__init__(_Publishers(node), on_fate)
