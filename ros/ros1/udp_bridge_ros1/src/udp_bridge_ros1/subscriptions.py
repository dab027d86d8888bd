# SPDX-License-Identifier: Apache-2.0
"""Subscriptions of ROS 1: ROS 1's bytes come in, CDR goes out.

Rule: rospy's threads only hand over, to a queue that keeps the newest; messages are turned and
told of in the thread that calls `turn`.
"""

from __future__ import annotations

import logging
import threading
from collections import deque
from typing import TYPE_CHECKING, Any, Callable, Deque, Tuple

import rosgraph
import rospy

from udp_bridge.node.subscriptions import Subscription

from .cdr import ConversionPlan, MalformedMessage
from .messages import kind

if TYPE_CHECKING:
    from udp_bridge.wire.types import MessageType

Take = Callable[[bytes], None]
WAITING = 256
"""Messages of all topics that may wait for `turn`."""


class Ros1Subscriptions:
    """What an inlet needs of ROS."""

    def __init__(self) -> None:
        self.refused = 0
        """Messages that are none of their type."""
        self._waiting: Deque[Tuple[_Ear, bytes]] = deque(maxlen=WAITING)
        self._came = threading.Event()

    def get_logger(self) -> logging.Logger:
        """Return rospy's, which the terminal and /rosout hear."""
        return logging.getLogger("rosout")

    def now_nanos(self) -> int:
        """Return the time as ROS has it, which is the simulation's with `use_sim_time`."""
        return int(rospy.get_rostime().to_nsec())

    def type_of(self, topic: str) -> str:
        """Return the full ROS 2 type name of a topic; empty where nobody publishes it."""
        types = dict(rosgraph.Master(rospy.get_name()).getTopicTypes())
        return str(types.get(rospy.resolve_name(topic), "")).replace("/", "/msg/")

    def subscribe(self, row: MessageType, topic: str, take: Take) -> Subscription:
        """Have `take` called with the CDR of each message, in the thread of `turn`."""
        raw, plan = kind(str(row.ros_type))
        ear = _Ear(plan, take)

        def hear(message: Any) -> None:
            self._waiting.append((ear, message.chunks[0]))
            self._came.set()

        subscriber = rospy.Subscriber(topic, raw, hear, queue_size=10, tcp_nodelay=True)

        def end() -> None:
            ear.is_open = False
            subscriber.unregister()

        return Subscription(plan.is_stamped, end)

    def wake(self) -> None:
        """Have `turn` wait no longer; from any thread."""
        self._came.set()

    def turn(self, wait_s: float) -> None:
        """Wait for messages, so long at most, and tell of all that came."""
        self._came.wait(wait_s)
        self._came.clear()
        while self._waiting:
            ear, body = self._waiting.popleft()
            try:
                if ear.is_open:
                    ear.take(ear.plan.to_cdr(body))
            except MalformedMessage:
                self.refused += 1


class _Ear:
    """Who hears a topic."""

    def __init__(self, plan: ConversionPlan, take: Take) -> None:
        self.plan = plan
        self.take = take
        self.is_open = True
