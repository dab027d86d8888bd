# SPDX-License-Identifier: Apache-2.0
"""Responses that lockstep expects of ROS, and the publishers and subscribers that give them.

`response_ledger` counts them. A responder that has left the graph is excused: what was published
before its return never reached it.
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
    List,
    Optional,
    Protocol,
    Set,
    Tuple,
)

from udp_bridge.wire.lockstep import ExpectedResponse
from udp_bridge.wire.message import TopicKey

from .response_ledger import ResponseLedger
from .subscriptions import RosSample

CHECK_S = 0.5
"""Period of the check whether a responder is still in the graph."""


class RosGraph(Protocol):
    """Publishers and subscribers of topics in ROS."""

    def publishers(self, topic: str) -> FrozenSet[Hashable]:
        """Return identities of a topic's publishers; a restarted publisher has a new one."""

    def has_publisher(self, topic: str) -> bool:
        """Return whether a topic has a publisher."""

    def has_subscriber(self, topic: str, is_own: bool) -> bool:
        """Return whether a topic has a subscriber, besides the bridge itself if `is_own`."""

    def listen(self, topic: str, take: Callable[[RosSample], object]) -> object:
        """Have `take` called with each message of a topic of any type; from any thread.

        Returns an object to keep as long as the subscription is needed, or None while the type of
        the topic is unknown.
        """


class ResponseTracker:
    """Counts due responses of the present Barriers, and watches the responders.

    Parameters
    ----------
    graph
        Knows publishers and subscribers.
    on_message
        Called with the topic of each message that the tracker subscribed to, and the message.
    """

    def __init__(self, graph: RosGraph, on_message: Callable[[str, RosSample], object]) -> None:
        self._graph, self._on_message = graph, on_message
        self._lock = Lock()  # guards the ledger
        self._expected: Tuple[ExpectedResponse, ...] = ()
        self._ledger = ResponseLedger(())
        self._subscriptions: Dict[str, object] = {}  # to responses of any type
        self._matched: Set[str] = set()
        self._publishers: Dict[str, FrozenSet[Hashable]] = {}
        self._checked_s = 0.0

    def expect(self, expected: Tuple[ExpectedResponse, ...]) -> None:
        """Set the expected responses; if they change, nothing is due any more."""
        if expected != self._expected:
            with self._lock:
                self._expected = expected
                self._ledger = ResponseLedger(expected)

    def published(self, topic: str, stamp_nanos: Optional[int]) -> bool:
        """Count a message before it is published; return whether a node works on it."""
        with self._lock:
            return self._ledger.published(topic, stamp_nanos)

    def received(self, topic: str, sample: RosSample) -> None:
        """Note a message of ROS."""
        with self._lock:
            self._ledger.received(topic, sample.stamp_nanos)

    def due_topic(self) -> str:
        """Return a topic on which a response is due; empty when none is."""
        with self._lock:
            return self._ledger.owing()

    def settle(self) -> List[Tuple[str, int]]:
        """Return topics with the number of messages that nothing caused, and forget these."""
        with self._lock:
            return self._ledger.settle()

    def forgive_absent(self, now_s: float) -> None:
        """Expect no response of publishers that have left; from the thread of `turn`."""
        if now_s - self._checked_s < CHECK_S:
            return
        self._checked_s = now_s
        for topic in {response.topic for response in self._expected}:
            before = self._publishers.get(topic, frozenset())
            now = self._graph.publishers(topic)
            self._publishers[topic] = now
            if not now or not before <= now:
                with self._lock:
                    self._ledger.forgive(topic)

    def forgive_all(self) -> None:
        """Expect no response to what has been published."""
        with self._lock:
            for topic in {response.topic for response in self._expected}:
                self._ledger.forgive(topic)

    def unmatched_topic(self, published: Collection[str]) -> str:
        """Return a topic without the publisher or subscriber that has to respond; else empty."""
        causes = self._ledger.caused(set(published))
        for response in self._expected:
            if response.of in causes:
                for topic, is_matched in self._endpoints(response):
                    if not is_matched:
                        return topic
        return ""

    def update(self, published: Collection[str], subscribed: Collection[TopicKey]) -> bool:
        """Subscribe to responses; return whether an endpoint is new since the last update.

        From the thread that `turn`s the bridge.
        """
        causes = self._ledger.caused(set(published))
        for response in self._expected:
            if response.msg_type and (response.msg_type, response.topic) not in subscribed:
                self._subscriptions.pop(response.topic, None)  # its lease ran out
            if response.of not in causes or response.topic in self._subscriptions:
                continue
            if not response.msg_type:
                kept = self._graph.listen(response.topic, partial(self._on_message, response.topic))
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
        yield (
            response.of,
            self._graph.has_subscriber(response.of, response.of in self._subscriptions),
        )
