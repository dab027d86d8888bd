# SPDX-License-Identifier: Apache-2.0
"""ResponseTracker that ROS owes to messages which were published: counted, topic by topic.

Rule: for each message of a topic that is to be answered one is due on another topic; which message
answers which is not asked, and one that comes unasked counts for nothing. Who has gone owes
nothing, for what was published before he came back he never got.
"""

from __future__ import annotations

from functools import partial
from threading import Lock
from typing import (
    TYPE_CHECKING,
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

if TYPE_CHECKING:
    from udp_bridge.wire.lockstep import ExpectedResponse

    from .subscriptions import Key

LOOK_S = 0.5
"""How often it is looked whether somebody who owes an answer is still there."""


class RosGraph(Protocol):
    """Who is there in ROS, as far as answers are concerned."""

    def publishers(self, topic: str) -> FrozenSet[Hashable]:
        """Return who publishes on a topic: others, if one comes back after it had gone."""

    def is_published(self, topic: str) -> bool:
        """Tell whether anybody publishes on a topic."""

    def is_heard(self, topic: str) -> bool:
        """Tell whether somebody listens to what the bridge publishes on a topic."""

    def listen(self, topic: str, take: Callable[[], object]) -> object:
        """Have `take` called at each message of a topic of whatever type; from any thread.

        Returns what is to be kept as long as it is wanted, or None where the topic is of no type
        yet.
        """


class ResponseTracker:
    """What is due to the present Barriers, and who is there to answer.

    Parameters
    ----------
    graph
        Knows who publishes and who listens.
    """

    def __init__(self, graph: RosGraph) -> None:
        self._graph = graph
        self._lock = Lock()  # guards what is owed
        self._expected: Tuple[ExpectedResponse, ...] = ()
        self._owed: Dict[ExpectedResponse, int] = {}
        self._subscriptions: Dict[str, object] = {}  # to answers of any type
        self._present: Set[str] = set()
        self._who: Dict[str, FrozenSet[Hashable]] = {}
        self._looked_s = 0.0

    def expect(self, expected: Tuple[ExpectedResponse, ...]) -> None:
        """Say which answers count from now on; what is owed to others is forgotten."""
        if expected != self._expected:
            with self._lock:
                self._expected = expected
                self._owed = {answer: self._owed.get(answer, 0) for answer in expected}

    def due(self, published: Iterable[str]) -> bool:
        """Take note, before they are published, of messages that are to be answered, by topics.

        Returns whether there are any.
        """
        with self._lock:
            for topic in published:
                for answer in self._expected:
                    self._owed[answer] += answer.of == topic
            return any(self._owed.values())

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
        """Expect no answer of those who have gone; from the thread of `BarrierResponder.turn`."""
        if now_s - self._looked_s < LOOK_S:
            return
        self._looked_s = now_s
        for answer in self._expected:
            before, now = (
                self._who.get(answer.topic, frozenset()),
                self._graph.publishers(answer.topic),
            )
            self._who[answer.topic] = now
            if not now or not before <= now:
                with self._lock:
                    self._owed[answer] = 0

    def give_up(self) -> None:
        """Expect no answer to what has been published."""
        with self._lock:
            self._owed = dict.fromkeys(self._owed, 0)

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

        From the thread that `turn`s the bridge.
        """
        for answer in self._expected:
            if answer.msg_type and (answer.msg_type, answer.topic) not in subscribed:
                self._subscriptions.pop(answer.topic, None)  # its lease ran out
            if answer.of not in published or answer.topic in self._subscriptions:
                continue
            if not answer.msg_type:
                kept = self._graph.listen(answer.topic, partial(self.heard, answer.topic))
                if kept is not None:
                    self._subscriptions[answer.topic] = kept
            elif (answer.msg_type, answer.topic) in subscribed:
                self._subscriptions[answer.topic] = None  # the inlet's
            self._who[answer.topic] = self._graph.publishers(answer.topic)
        present = {
            topic
            for answer in self._expected
            for topic, is_there in self._endpoints(answer)
            if is_there
        }
        is_news = not present <= self._present
        self._present = present
        return is_news

    def _endpoints(self, answer: ExpectedResponse) -> Iterable[Tuple[str, bool]]:
        is_heard = answer.topic in self._subscriptions
        yield answer.topic, is_heard and self._graph.is_published(answer.topic)
        yield answer.of, self._graph.is_heard(answer.of)
