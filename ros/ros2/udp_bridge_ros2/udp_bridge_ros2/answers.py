# SPDX-License-Identifier: Apache-2.0
"""Answers that ROS owes to messages which were published: counted, topic by topic.

Rule: for each message of a topic that is to be answered one is due on another topic; which message
answers which is not asked, and one that comes unasked counts for nothing. Who has gone owes
nothing, for what was published before he came back he never got.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from functools import partial
from threading import Lock
from typing import TYPE_CHECKING, Any

from . import topics

if TYPE_CHECKING:
    from rclpy.node import Node

    from udp_bridge.lockstep import Answer
    from udp_bridge.ros_end.inlet import Key

LOOK_S = 0.5
"""How often it is looked whether somebody who owes an answer is still there."""


class Answers:
    """What is due to the present Barriers, and who is there to answer.

    Parameters
    ----------
    node
        Knows who publishes and who listens.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._lock = Lock()  # guards what is owed
        self._expected: tuple[Answer, ...] = ()
        self._owed: dict[Answer, int] = {}
        self._subscriptions: dict[str, Any] = {}  # to answers of any type
        self._present: set[str] = set()
        self._who: dict[str, frozenset[bytes]] = {}
        self._looked_s = 0.0

    def expect(self, expected: tuple[Answer, ...]) -> None:
        """Say which answers count from now on; what is owed to others is forgotten."""
        if expected != self._expected:
            with self._lock:
                self._expected = expected
                self._owed = {answer: self._owed.get(answer, 0) for answer in expected}

    def due(self, published: Iterable[str]) -> None:
        """Take note, before they are published, of messages that are to be answered, by topics."""
        with self._lock:
            for topic in published:
                for answer in self._expected:
                    self._owed[answer] += answer.of == topic

    def heard(self, topic: str) -> None:
        """Take note of a message of ROS."""
        with self._lock:
            for answer, owed in self._owed.items():
                if answer.topic == topic and owed:
                    self._owed[answer] = owed - 1

    def owed(self) -> str:
        """Return a topic on which an answer is due; empty when none is."""
        with self._lock:
            return next((answer.topic for answer, owed in self._owed.items() if owed), "")

    def forgive(self, now_s: float) -> None:
        """Expect no answer of those who have gone; from the thread that spins the node."""
        if now_s - self._looked_s < LOOK_S:
            return
        self._looked_s = now_s
        for answer in self._expected:
            before, now = self._who.get(answer.topic, frozenset()), self._publishers(answer.topic)
            self._who[answer.topic] = now
            if not now or not before <= now:
                with self._lock:
                    self._owed[answer] = 0

    def absent(self, published: Collection[str]) -> str:
        """Return a topic whose publisher or reader is missing to answer these; empty for none."""
        for answer in self._expected:
            if answer.of in published:
                for topic, is_there in self._endpoints(answer):
                    if not is_there:
                        return topic
        return ""

    def look(self, published: Collection[str], subscribed: Collection[Key]) -> bool:
        """Subscribe to what is to be answered; return whether somebody is new since the last look.

        From the thread that spins the node.
        """
        for answer in self._expected:
            if answer.of not in published or answer.topic in self._subscriptions:
                continue
            if not answer.msg_type:
                self._subscribe(answer.topic)
            elif (answer.msg_type, answer.topic) in subscribed:
                self._subscriptions[answer.topic] = None  # the inlet's
            self._who[answer.topic] = self._publishers(answer.topic)
        present = {
            topic
            for answer in self._expected
            for topic, is_there in self._endpoints(answer)
            if is_there
        }
        is_news = not present <= self._present
        self._present = present
        return is_news

    def _endpoints(self, answer: Answer) -> Iterable[tuple[str, bool]]:
        is_heard = answer.topic in self._subscriptions
        yield answer.topic, is_heard and self._node.count_publishers(answer.topic) > 0
        yield answer.of, self._node.count_subscribers(answer.of) > 0

    def _publishers(self, topic: str) -> frozenset[bytes]:
        return frozenset(
            bytes(info.endpoint_gid) for info in self._node.get_publishers_info_by_topic(topic)
        )

    def _subscribe(self, topic: str) -> None:
        """Subscribe to a topic of any type, as soon as there is one."""
        for info in self._node.get_publishers_info_by_topic(topic):
            self._subscriptions[topic] = self._node.create_subscription(
                topics.message_class(info.topic_type),
                topic,
                partial(self._take, topic),
                topics.subscribed(""),
                raw=True,
            )
            return

    def _take(self, topic: str, _: bytes) -> None:
        self.heard(topic)
