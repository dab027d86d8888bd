# SPDX-License-Identifier: Apache-2.0
"""What DDS is told of each topic, beside what `udp_bridge.node.topic_qos` says of it.

Rule: nobody is left out. A DDS writer that offers `reliable` serves reliable and best-effort
readers alike, one that offers best effort serves only the latter; a reader is the other way round.
So every publisher offers reliable: RViz and a plain ``create_subscription(..., 10)`` match, and
sensor-data readers get best effort as they asked. It never blocks, as only the last `depth`
messages are kept; all it costs is that a reliable reader which lags is sent those again.
"""

from __future__ import annotations

from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    QoSPolicyKind,
    QoSProfile,
    ReliabilityPolicy,
)
from rclpy.qos_overriding_options import QoSOverridingOptions

from udp_bridge.node.topic_qos import TopicQos

OVERRIDES = QoSOverridingOptions(
    [
        QoSPolicyKind.HISTORY,
        QoSPolicyKind.DEPTH,
        QoSPolicyKind.RELIABILITY,
        QoSPolicyKind.DURABILITY,
    ]
)
"""What a user can change of each topic, by parameters such as
`qos_overrides./imu.publisher.reliability`."""

_SUBSCRIBED = {
    # Maps are published once and latched; this only matches publishers that do so.
    "OccupancyGrid": TopicQos(depth=1, is_latched=True),
}


def published(qos: TopicQos) -> QoSProfile:
    """Return how a topic is published; latched is transient local."""
    return _qos(qos, ReliabilityPolicy.RELIABLE)


def subscribed(type_name: str) -> QoSProfile:
    """Return how a message type of the wire is subscribed to."""
    if type_name in _SUBSCRIBED:
        return _qos(_SUBSCRIBED[type_name], ReliabilityPolicy.RELIABLE)
    # Matches every publisher; on one host shared memory loses nothing of this size.
    return _qos(TopicQos(depth=10), ReliabilityPolicy.BEST_EFFORT)


def _qos(qos: TopicQos, reliability: ReliabilityPolicy) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=qos.depth,
        reliability=reliability,
        durability=DurabilityPolicy.TRANSIENT_LOCAL
        if qos.is_latched
        else DurabilityPolicy.VOLATILE,
    )
