# SPDX-License-Identifier: Apache-2.0
"""Publisher of the node's counters on /diagnostics, once a second, as DiagnosticArray.

The array has one status for each topic and peer, and one for the link.
`udp_bridge.node.diagnostics` sets the levels.
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
    """Publisher of a link's counters; call `turn` several times a second."""

    def __init__(self, node: Node, link: Link) -> None:
        self._node = node
        self._link = link
        self._node_diagnostics = NodeDiagnostics()
        self._due_nanos: int | None = None
        self._publisher: Any = None

    def turn(self, now_nanos: int) -> None:
        """Publish once a second, for the first time one second after the first call."""
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
        if self._publisher is None:  # created late, so that it does not delay the first data
            self._publisher = self._node.create_publisher(DiagnosticArray, TOPIC, 1)
        message = DiagnosticArray()
        message.header.stamp = self._node.get_clock().now().to_msg()
        host, port = self._link.address
        message.status = [
            _status(row, f"{host}:{port}")
            for row in self._node_diagnostics.all_of(self._link, now_nanos)
        ]
        self._publisher.publish(message)


def _status(row: StatusRow, address: str) -> Any:
    from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

    return DiagnosticStatus(
        level=bytes([row.level]),
        name=f"udp_bridge: {row.name}",
        message=row.message,
        hardware_id=f"udp_bridge {address}",
        values=[KeyValue(key=key, value=value) for key, value in row.values.items()],
    )
