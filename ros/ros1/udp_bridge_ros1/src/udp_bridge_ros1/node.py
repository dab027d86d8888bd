# SPDX-License-Identifier: Apache-2.0
"""ROS 1 node: parameters, and a `BridgeNode` with ROS 1's publishers and subscriptions."""

from __future__ import annotations

import logging
import time
from typing import Any, Callable, FrozenSet, Hashable, List, Optional

import rospy
from diagnostic_msgs.msg import DiagnosticArray
from rospy.impl.registration import Registration, get_topic_manager

from udp_bridge.node.bridge_node import BridgeNode, Settings
from udp_bridge.node.command_client import RunCommandClient
from udp_bridge.node.diagnostics import TOPIC, DiagnosticsPublisher
from udp_bridge.node.run_control import RunControl, triggers
from udp_bridge.node.subscriptions import RosSample

from .publishers import Ros1Publishers
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
        wake = self._subscriptions.wake
        self._bridge = BridgeNode(
            *(Settings(**settings), publishers, self._subscriptions, Ros1Graph(wake)), wake=wake
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


class Ros1Services:
    """Services that pause, step and reset the run, until `close`: std_srvs/Trigger as `~pause`.

    rospy serves each caller in its own thread, so a waiting call does not block other calls. Logs
    a warning if std_srvs is not installed.
    """

    def __init__(self, client: RunCommandClient, log: logging.Logger) -> None:
        self._client = client
        self._services = []
        try:
            from std_srvs.srv import Trigger, TriggerResponse
        except ImportError:
            log.warning("std_srvs is not installed: no services")
            return
        filled = triggers(RunControl(client), lambda: int(rospy.get_param("~step_ticks", 1)))
        for name, fill in filled.items():
            serve = lambda _, fill=fill: fill(TriggerResponse())  # noqa: E731
            self._services.append(rospy.Service(f"~{name}", Trigger, serve))
        log.info(f"services of std_srvs at {rospy.get_name()}/: {', '.join(filled)}")

    def close(self) -> None:
        """Stop the services; waiting calls fail."""
        self._client.close()
        for service in self._services:
            service.shutdown()


class Ros1Graph:
    """Publishers and subscribers in the ROS 1 graph (`udp_bridge.node.responses.RosGraph`).

    Only connections of this node count. A message that is published before the connection exists
    does not reach the subscriber, and the master also lists nodes that have crashed.

    Parameters
    ----------
    wake
        Wakes the thread that calls `turn`; called from any thread.
    """

    def __init__(self, wake: Callable[[], object]) -> None:
        self._wake = wake

    def publishers(self, topic: str) -> FrozenSet[Hashable]:
        """Return identities of a topic's publishers; a restarted publisher has a new one."""
        return frozenset(connection.id for connection in _connections(Registration.SUB, topic))

    def has_publisher(self, topic: str) -> bool:
        """Return whether a topic has a publisher."""
        return bool(_connections(Registration.SUB, topic))

    def has_subscriber(self, topic: str, is_own: bool) -> bool:
        """Return whether a topic has a subscriber; True where only other nodes publish it."""
        return is_own or bool(_connections(Registration.PUB, topic))

    def listen(self, topic: str, take: Callable[[RosSample], object]) -> object:
        """Subscribe to a topic of any type. Its messages count by number, as without a stamp."""

        def received(message: rospy.AnyMsg) -> None:
            take(RosSample("", None, message._buff))
            self._wake()

        return rospy.Subscriber(topic, rospy.AnyMsg, received, queue_size=10)


def _connections(kind: str, topic: str) -> List[Any]:
    found = get_topic_manager().get_impl(kind, rospy.resolve_name(topic))
    return list(found.connections or ()) if found is not None else []  # None during shutdown
