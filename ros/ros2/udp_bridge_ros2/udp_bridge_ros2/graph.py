# SPDX-License-Identifier: Apache-2.0
"""The ROS 2 graph: who publishes and who subscribes (`udp_bridge.node.responses.RosGraph`)."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from functools import partial
from typing import TYPE_CHECKING

from udp_bridge.node.message_class import message_class

from . import qos as topics

if TYPE_CHECKING:
    from rclpy.node import Node


class Ros2Graph:
    """The graph that a node sees; from the thread that spins it."""

    def __init__(self, node: Node) -> None:
        self._node = node

    def publishers(self, topic: str) -> frozenset[Hashable]:
        """Return who publishes on a topic: others, if one comes back after it had gone."""
        found = self._node.get_publishers_info_by_topic(topic)
        return frozenset(bytes(info.endpoint_gid) for info in found)

    def is_published(self, topic: str) -> bool:
        """Tell whether anybody publishes on a topic."""
        return bool(self._node.count_publishers(topic))

    def is_heard(self, topic: str) -> bool:
        """Tell whether somebody listens on a topic."""
        return bool(self._node.count_subscribers(topic))

    def listen(self, topic: str, take: Callable[[], object]) -> object:
        """Subscribe to a topic of any type, as soon as there is one."""
        for info in self._node.get_publishers_info_by_topic(topic):
            return self._node.create_subscription(
                message_class(info.topic_type),
                topic,
                partial(_take, take),
                topics.subscribed(""),
                raw=True,
            )
        return None


def _take(take: Callable[[], object], _: bytes) -> None:
    take()
