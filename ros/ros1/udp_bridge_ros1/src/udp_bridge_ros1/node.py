# SPDX-License-Identifier: Apache-2.0
"""ROS 1 node: parameters, and a `BridgeNode` with ROS 1's publishers and subscriptions."""

from __future__ import annotations

import time
from typing import Optional

import rospy
from diagnostic_msgs.msg import DiagnosticArray

from udp_bridge.node.bridge_node import BridgeNode, Settings
from udp_bridge.node.diagnostics import TOPIC, DiagnosticsPublisher

from .graph import Ros1Graph
from .publishers import Ros1Publishers
from .services import Ros1Services
from .subscriptions import Ros1Subscriptions


class Ros1Node:
    """ROS 1 end of UDP Bridge, in a process in which rospy is initialized.

    Its private parameters are those of `Settings`, and `~frame_prefix`, a prefix of all published
    frames.

    Parameters
    ----------
    given
        Settings that override the parameters of the same names, unless they are None.

    Raises
    ------
    ValueError
        When an address is invalid, or the key can't be used.
    OSError
        When an address can't be resolved or bound.
    """

    def __init__(self, **given: Optional[str]) -> None:
        settings = {
            name: given.get(name) or str(rospy.get_param(f"~{name}", default))
            for name, default in Settings()._asdict().items()
        }
        publishers = Ros1Publishers(str(rospy.get_param("~frame_prefix", "")))
        self._subscriptions = Ros1Subscriptions()
        self._bridge = BridgeNode(
            *(Settings(**settings), publishers, self._subscriptions, Ros1Graph()),
            wake=self._subscriptions.wake,
        )
        # Created at once, since rospy connects subscribers after some time.
        diagnostics = rospy.Publisher(TOPIC, DiagnosticArray, queue_size=1)
        self._diagnostics = DiagnosticsPublisher(
            self._bridge.link,
            advertise=lambda _: diagnostics,
            stamp=rospy.get_rostime,
            level=int,
            warn=publishers.get_logger().warning,
            lost=publishers.lost,
        )
        self._bridge.log_start()
        self._services = Ros1Services(self._bridge.command_client, publishers.get_logger())

    def turn(self) -> None:
        """Process requests of peers, for 0.1 s at most."""
        now_nanos = time.monotonic_ns()
        wait_s = self._bridge.turn(now_nanos)
        self._diagnostics.turn(now_nanos)
        self._subscriptions.turn(wait_s)

    def close(self) -> None:
        """Stop all threads and log the totals."""
        self._services.close()
        self._bridge.close(self._subscriptions.refused)
