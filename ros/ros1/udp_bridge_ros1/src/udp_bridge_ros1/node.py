# SPDX-License-Identifier: Apache-2.0
"""The node: an end of a bridge with ROS 1's publishers and subscriptions, and what it tells.

Rule: it only reads parameters and wires; what the end does is in `udp_bridge.node.bridge_node`.
"""

from __future__ import annotations

import time
from typing import Optional

import rospy

from udp_bridge.node.bridge_node import BridgeNode, Settings

from .diagnostics import Ros1Diagnostics
from .graph import Ros1Graph
from .publishers import Ros1Publishers
from .services import Ros1Services
from .subscriptions import Ros1Subscriptions


class Ros1Node:
    """The ROS 1 end of UDP Bridge, within a node that rospy has begun.

    Its private parameters are those of `Settings`, and `~frame_prefix`, which is put before frames
    of what it publishes.

    Parameters
    ----------
    given
        Settings by name that stand before the parameters of these names, where they are not None.

    Raises
    ------
    ValueError
        When an address is none, or the key is none that can be used.
    OSError
        When an address can't be resolved or bound.
    """

    def __init__(self, **given: Optional[str]) -> None:
        told = {
            name: given.get(name) or str(rospy.get_param(f"~{name}", default))
            for name, default in Settings()._asdict().items()
        }
        publishers = Ros1Publishers(str(rospy.get_param("~frame_prefix", "")))
        self._subscriptions = Ros1Subscriptions()
        self._end = BridgeNode(
            *(Settings(**told), publishers, self._subscriptions, Ros1Graph()),
            wake=self._subscriptions.wake,
        )
        self._diagnostics = Ros1Diagnostics(self._end.link, publishers.lost, time.monotonic_ns())
        self._end.tell_begin()
        self._services = Ros1Services(self._end.asking, publishers.get_logger())

    def turn(self) -> None:
        """Serve the wishes of peers for a moment, 0.1 s at most."""
        now_nanos = time.monotonic_ns()
        wait_s = self._end.turn(now_nanos)
        self._diagnostics.turn(now_nanos)
        self._subscriptions.turn(wait_s)

    def close(self) -> None:
        """End all threads and say in one line what was done."""
        self._services.close()
        self._end.close(self._subscriptions.refused)
