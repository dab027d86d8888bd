# SPDX-License-Identifier: Apache-2.0
"""Responses that lockstep expects of ROS, counted topic by topic.

For each published message of one topic, a message on another topic is due. Which message responds
to which is not checked, and a message without a cause counts for nothing. A responder that has left
the graph is excused: what was published before its return never reached it.
"""

from __future__ import annotations

from functools import partial
from threading import Lock
from typing import (
    Callable,
    Collection,
    Dict,
    FrozenSet,
    Hashable,
    Iterable,
    Protocol,
    Set,
    Tuple,
)

from udp_bridge.wire.lockstep import ExpectedResponse
from udp_bridge.wire.message import TopicKey

CHECK_S = 0.5
"""Period of the check whether a responder is still in the graph."""


class RosGraph(Protocol):
    """Publishers and subscribers of topics in ROS."""

    def publishers(self, topic: str) -> FrozenSet[Hashable]:
        """Return identities of a topic's publishers; a restarted publisher has a new one."""

    def has_publisher(self, topic: str) -> bool:
        """Return whether a topic has a publisher."""

    def has_subscriber(self, topic: str) -> bool:
        """Return whether a topic that the bridge publishes has a subscriber."""

    def listen(self, topic: str, take: Callable[[], object]) -> object:
        """Have `take` called at each message of a topic of any type; from any thread.

        Returns an object to keep as long as the subscription is needed, or None while the type of
        the topic is unknown.
        """


class ResponseTracker:
    """Counts due responses of the present Barriers, and watches the responders.

    Parameters
    ----------
    graph
        Knows publishers and subscribers.
    """

    def __init__(self, graph: RosGraph) -> None:
        self._graph = graph
        self._lock = Lock()  # guards _due
        self._expected: Tuple[ExpectedResponse, ...] = ()
        self._due: Dict[ExpectedResponse, int] = {}
        self._subscriptions: Dict[str, object] = {}  # to responses of any type
        self._matched: Set[str] = set()
        self._publishers: Dict[str, FrozenSet[Hashable]] = {}
        self._checked_s = 0.0

    def expect(self, expected: Tuple[ExpectedResponse, ...]) -> None:
        """Set the expected responses; due responses of others are forgotten."""
        if expected != self._expected:
            with self._lock:
                self._expected = expected
                self._due = {response: self._due.get(response, 0) for response in expected}

    def due(self, published: Iterable[str]) -> bool:
        """Count messages by topic before they are published; return whether a response is due."""
        with self._lock:
            for topic in published:
                for response in self._expected:
                    self._due[response] += response.of == topic
            return any(self._due.values())

    def received(self, topic: str) -> None:
        """Note a message of ROS."""
        with self._lock:
            for response, due in self._due.items():
                if response.topic == topic and due:
                    self._due[response] = due - 1

    def due_topic(self) -> str:
        """Return a topic on which a response is due; empty when none is."""
        with self._lock:
            return next((response.topic for response, due in self._due.items() if due), "")

    def forgive_absent(self, now_s: float) -> None:
        """Expect no response of publishers that have left; from the thread of `turn`."""
        if now_s - self._checked_s < CHECK_S:
            return
        self._checked_s = now_s
        for response in self._expected:
            before = self._publishers.get(response.topic, frozenset())
            now = self._graph.publishers(response.topic)
            self._publishers[response.topic] = now
            if not now or not before <= now:
                with self._lock:
                    self._due[response] = 0

    def forgive_all(self) -> None:
        """Expect no response to what has been published."""
        with self._lock:
            self._due = dict.fromkeys(self._due, 0)

    def unmatched_topic(self, published: Collection[str]) -> str:
        """Return a topic without the publisher or subscriber that has to respond; else empty."""
        for response in self._expected:
            if response.of in published:
                for topic, is_matched in self._endpoints(response):
                    if not is_matched:
                        return topic
        return ""

    def update(self, published: Collection[str], subscribed: Collection[TopicKey]) -> bool:
        """Subscribe to responses; return whether an endpoint is new since the last update.

        From the thread that `turn`s the bridge.
        """
        for response in self._expected:
            if response.msg_type and (response.msg_type, response.topic) not in subscribed:
                self._subscriptions.pop(response.topic, None)  # its lease ran out
            if response.of not in published or response.topic in self._subscriptions:
                continue
            if not response.msg_type:
                kept = self._graph.listen(response.topic, partial(self.received, response.topic))
                if kept is not None:
                    self._subscriptions[response.topic] = kept
            elif (response.msg_type, response.topic) in subscribed:
                self._subscriptions[response.topic] = None  # a leased subscription
            self._publishers[response.topic] = self._graph.publishers(response.topic)
        matched = {
            topic
            for response in self._expected
            for topic, is_matched in self._endpoints(response)
            if is_matched
        }
        is_new = not matched <= self._matched
        self._matched = matched
        return is_new

    def _endpoints(self, response: ExpectedResponse) -> Iterable[Tuple[str, bool]]:
        is_subscribed = response.topic in self._subscriptions
        yield response.topic, is_subscribed and self._graph.has_publisher(response.topic)
        yield response.of, self._graph.has_subscriber(response.of)
