# SPDX-License-Identifier: Apache-2.0
"""Publishers and subscribers in the ROS 1 graph (`udp_bridge.node.responses.RosGraph`).

Only connections of this node count. A message that is published before the connection exists does
not reach the subscriber, and the master also lists nodes that have crashed.
"""

from __future__ import annotations

from typing import Any, Callable, FrozenSet, Hashable, List

import rospy
from rospy.impl.registration import Registration, get_topic_manager


class Ros1Graph:
    """Connections of this node."""

    def publishers(self, topic: str) -> FrozenSet[Hashable]:
        """Return identities of a topic's publishers; a restarted publisher has a new one."""
        return frozenset(connection.id for connection in _connections(Registration.SUB, topic))

    def has_publisher(self, topic: str) -> bool:
        """Return whether a topic has a publisher."""
        return bool(_connections(Registration.SUB, topic))

    def has_subscriber(self, topic: str) -> bool:
        """Return whether a topic has a subscriber."""
        return bool(_connections(Registration.PUB, topic))

    def listen(self, topic: str, take: Callable[[], object]) -> object:
        """Subscribe to a topic of any type."""
        return rospy.Subscriber(topic, rospy.AnyMsg, lambda _: take(), queue_size=10)


def _connections(kind: str, topic: str) -> List[Any]:
    found = get_topic_manager().get_impl(kind, rospy.resolve_name(topic))
    return list(found.connections or ()) if found is not None else []  # None during shutdown
