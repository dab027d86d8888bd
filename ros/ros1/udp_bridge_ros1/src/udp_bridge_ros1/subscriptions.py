# SPDX-License-Identifier: Apache-2.0
"""Subscriptions for ROS 1, which convert the serialization of ROS 1 to CDR.

rospy's threads only append to a queue that keeps the newest messages. The thread that calls `turn`
converts the messages and runs the callbacks.
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
from .messages import raw_type

if TYPE_CHECKING:
    from udp_bridge.wire.types import MessageType

Take = Callable[[bytes], None]
WAITING = 256
"""Capacity of the queue for `turn`, in messages of all topics."""


class Ros1Subscriptions:
    """Factory of subscriptions."""

    def __init__(self) -> None:
        self.refused = 0
        """Number of messages that do not match their type."""
        self._waiting: Deque[Tuple[_Subscriber, bytes]] = deque(maxlen=WAITING)
        self._came = threading.Event()

    def get_logger(self) -> logging.Logger:
        """Return rospy's logger, which writes to the terminal and /rosout."""
        return logging.getLogger("rosout")

    def now_nanos(self) -> int:
        """Return ROS time in nanoseconds; with `use_sim_time` this is sim time."""
        return int(rospy.get_rostime().to_nsec())

    def type_of(self, topic: str) -> str:
        """Return the ROS 2 type name of a published topic; empty without a publisher."""
        types = dict(rosgraph.Master(rospy.get_name()).getTopicTypes())
        return str(types.get(rospy.resolve_name(topic), "")).replace("/", "/msg/")

    def subscribe(self, row: MessageType, topic: str, take: Take) -> Subscription:
        """Call `take` with the CDR of each message, in the thread of `turn`."""
        raw, plan = raw_type(str(row.ros_type))
        ours = _Subscriber(plan, take)

        def append(message: Any) -> None:
            self._waiting.append((ours, message.chunks[0]))
            self._came.set()

        subscriber = rospy.Subscriber(topic, raw, append, queue_size=10, tcp_nodelay=True)

        def end() -> None:
            ours.is_open = False
            subscriber.unregister()

        return Subscription(plan.is_stamped, end)

    def wake(self) -> None:
        """Wake `turn`. Thread-safe."""
        self._came.set()

    def turn(self, wait_s: float) -> None:
        """Wait for messages for a limited time, and run the callbacks of all that arrived."""
        self._came.wait(wait_s)
        self._came.clear()
        while self._waiting:
            ours, body = self._waiting.popleft()
            try:
                if ours.is_open:
                    ours.take(ours.plan.to_cdr(body))
            except MalformedMessage:
                self.refused += 1


class _Subscriber:
    """Subscriber of a topic."""

    def __init__(self, plan: ConversionPlan, take: Take) -> None:
        self.plan = plan
        self.take = take
        self.is_open = True
