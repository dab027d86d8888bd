# SPDX-License-Identifier: Apache-2.0
"""Publishers and subscribers in the ROS 2 graph (`udp_bridge.node.responses.RosGraph`)."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from functools import partial
from typing import TYPE_CHECKING

from udp_bridge.node.message_class import message_class

from . import qos as qos_profiles

if TYPE_CHECKING:
    from rclpy.node import Node


class Ros2Graph:
    """Graph as a node sees it. Use it only in the thread that spins the node."""

    def __init__(self, node: Node) -> None:
        self._node = node

    def publishers(self, topic: str) -> frozenset[Hashable]:
        """Return identities of a topic's publishers; a restarted publisher has a new one."""
        found = self._node.get_publishers_info_by_topic(topic)
        return frozenset(bytes(info.endpoint_gid) for info in found)

    def has_publisher(self, topic: str) -> bool:
        """Return whether a topic has a publisher."""
        return bool(self._node.count_publishers(topic))

    def has_subscriber(self, topic: str) -> bool:
        """Return whether a topic has a subscriber."""
        return bool(self._node.count_subscribers(topic))

    def listen(self, topic: str, take: Callable[[], object]) -> object:
        """Subscribe to a topic of any type, as soon as its type is known."""
        for info in self._node.get_publishers_info_by_topic(topic):
            return self._node.create_subscription(
                message_class(info.topic_type),
                topic,
                partial(_take, take),
                qos_profiles.subscription_profile(""),
                raw=True,
            )
        return None


def _take(take: Callable[[], object], _: bytes) -> None:
    take()
