# SPDX-License-Identifier: Apache-2.0
"""The node's counters on /diagnostics, once a second, as diagnostic_msgs/DiagnosticArray.

Rule: one status for each topic and peer and one for the link; what they say is in
`udp_bridge.node.diagnostics`.
Where the message package is not installed nothing is published, and one line says so.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from udp_bridge.node.diagnostics import NodeDiagnostics, StatusRow

if TYPE_CHECKING:
    from rclpy.node import Node

    from udp_bridge import Link

TOPIC = "/diagnostics"
PERIOD_NANOS = 1_000_000_000


class Ros2Diagnostics:
    """Publishes what a link counts; `turn` is to be called several times a second."""

    def __init__(self, node: Node, link: Link) -> None:
        self._node = node
        self._link = link
        self._verdicts = NodeDiagnostics()
        self._due_nanos: int | None = None
        self._publisher: Any = None

    def turn(self, now_nanos: int) -> None:
        """Publish when a second has passed, for the first time a second after the first call."""
        if self._due_nanos is None:
            self._due_nanos = now_nanos + PERIOD_NANOS
        if now_nanos < self._due_nanos:
            return
        self._due_nanos = now_nanos + PERIOD_NANOS
        try:
            from diagnostic_msgs.msg import DiagnosticArray
        except ImportError:
            self._node.get_logger().warning("diagnostic_msgs is not installed: no /diagnostics")
            self._due_nanos = sys.maxsize
            return
        if self._publisher is None:  # not at the start, which data may be waiting for
            self._publisher = self._node.create_publisher(DiagnosticArray, TOPIC, 1)
        message = DiagnosticArray()
        message.header.stamp = self._node.get_clock().now().to_msg()
        host, port = self._link.address
        message.status = [
            _status(verdict, f"{host}:{port}")
            for verdict in self._verdicts.all_of(self._link, now_nanos)
        ]
        self._publisher.publish(message)


def _status(verdict: StatusRow, address: str) -> Any:
    from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

    return DiagnosticStatus(
        level=bytes([verdict.level]),
        name=f"udp_bridge: {verdict.name}",
        message=verdict.message,
        hardware_id=f"udp_bridge {address}",
        values=[KeyValue(key=key, value=value) for key, value in verdict.values.items()],
    )
