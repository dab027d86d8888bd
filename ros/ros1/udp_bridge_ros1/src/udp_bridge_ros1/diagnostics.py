# SPDX-License-Identifier: Apache-2.0
"""Publisher of the node's counters on /diagnostics, once a second, as DiagnosticArray.

The array has one status for each topic and peer, and one for the link.
`udp_bridge.node.diagnostics` sets the levels.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Callable, Mapping

import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from udp_bridge.node.diagnostics import NodeDiagnostics, StatusRow

if TYPE_CHECKING:
    from udp_bridge import Link

TOPIC = "/diagnostics"
PERIOD_NANOS = 1_000_000_000


class Ros1Diagnostics:
    """Publisher of a link's counters; call `turn` several times a second.

    Parameters
    ----------
    lost
        Returns the number of messages of a topic that each subscriber missed.
    """

    def __init__(
        self, link: Link, lost: Callable[[str], Mapping[str, int]], now_nanos: int
    ) -> None:
        self._link, self._lost = link, lost
        self._node_diagnostics = NodeDiagnostics()
        self._due_nanos = now_nanos + PERIOD_NANOS
        self._publisher = rospy.Publisher(TOPIC, DiagnosticArray, queue_size=1)

    def turn(self, now_nanos: int) -> None:
        """Publish if a second has passed since the last time."""
        if now_nanos < self._due_nanos:
            return
        self._due_nanos = now_nanos + PERIOD_NANOS
        host, port = self._link.address
        message = DiagnosticArray()
        message.header.stamp = rospy.get_rostime()
        message.status = [
            _status(row, f"{host}:{port}")
            for row in self._node_diagnostics.all_of(self._link, now_nanos, lost=self._lost)
        ]
        self._publisher.publish(message)


def _status(row: StatusRow, address: str) -> Any:
    return DiagnosticStatus(
        level=row.level,
        name=f"udp_bridge: {row.name}",
        message=row.message,
        hardware_id=f"udp_bridge {address}",
        values=[KeyValue(key=key, value=value) for key, value in row.values.items()],
    )
