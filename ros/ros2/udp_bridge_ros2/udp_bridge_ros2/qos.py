# SPDX-License-Identifier: Apache-2.0
"""QoS profiles for ROS 2, from the table in `udp_bridge.node.topic_qos`.

Every publisher offers `reliable`. DDS then matches reliable and best-effort subscribers alike, such
as RViz, ``create_subscription(..., 10)`` and the sensor-data profile. A reliable publisher never
blocks here, because only the last `depth` messages are kept; a slow reliable subscriber costs
retransmissions. A subscription requests best effort, which also matches every publisher.
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
"""Policies that a user can override with parameters such as
`qos_overrides./imu.publisher.reliability`."""

_SUBSCRIBED = {
    # Maps are published once and latched; this profile matches only such publishers.
    "OccupancyGrid": TopicQos(depth=1, is_latched=True),
}


def publisher_profile(qos: TopicQos) -> QoSProfile:
    """Return the profile of a publisher; a latched topic is transient local."""
    return _qos(qos, ReliabilityPolicy.RELIABLE)


def subscription_profile(type_name: str) -> QoSProfile:
    """Return the profile of a subscription to a wire type."""
    if type_name in _SUBSCRIBED:
        return _qos(_SUBSCRIBED[type_name], ReliabilityPolicy.RELIABLE)
    # Best effort matches every publisher. On one host, shared memory loses no message of this size.
    return _qos(TopicQos(depth=10), ReliabilityPolicy.BEST_EFFORT)


def listening_profile(reliability: ReliabilityPolicy) -> QoSProfile:
    """Return the profile of a subscription to a publisher with this reliability.

    Lockstep waits for each message, so none may be lost between hosts.
    """
    if reliability != ReliabilityPolicy.RELIABLE:
        reliability = ReliabilityPolicy.BEST_EFFORT
    return _qos(TopicQos(depth=100), reliability)


def _qos(qos: TopicQos, reliability: ReliabilityPolicy) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=qos.depth,
        reliability=reliability,
        durability=DurabilityPolicy.TRANSIENT_LOCAL
        if qos.is_latched
        else DurabilityPolicy.VOLATILE,
    )
