# SPDX-License-Identifier: Apache-2.0
"""The node's counters on /diagnostics, once a second, as diagnostic_msgs/DiagnosticArray.

Rule: one status for each topic and peer and one for the link; what they say is decided in
`udp_bridge.node.diagnostics`.
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
    """Publishes what a link counts; `turn` is to be called several times a second.

    Parameters
    ----------
    lost
        Returns by subscriber how many messages of a topic it did not take.
    """

    def __init__(
        self, link: Link, lost: Callable[[str], Mapping[str, int]], now_nanos: int
    ) -> None:
        self._link, self._lost = link, lost
        self._verdicts = NodeDiagnostics()
        self._due_nanos = now_nanos + PERIOD_NANOS
        self._publisher = rospy.Publisher(TOPIC, DiagnosticArray, queue_size=1)

    def turn(self, now_nanos: int) -> None:
        """Publish when a second has passed."""
        if now_nanos < self._due_nanos:
            return
        self._due_nanos = now_nanos + PERIOD_NANOS
        host, port = self._link.address
        message = DiagnosticArray()
        message.header.stamp = rospy.get_rostime()
        message.status = [
            _status(verdict, f"{host}:{port}")
            for verdict in self._verdicts.all_of(self._link, now_nanos, lost=self._lost)
        ]
        self._publisher.publish(message)


def _status(verdict: StatusRow, address: str) -> Any:
    return DiagnosticStatus(
        level=verdict.level,
        name=f"udp_bridge: {verdict.name}",
        message=verdict.message,
        hardware_id=f"udp_bridge {address}",
        values=[KeyValue(key=key, value=value) for key, value in verdict.values.items()],
    )
