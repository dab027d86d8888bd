# SPDX-License-Identifier: Apache-2.0
"""Ledger of the messages that ROS owes, topic by topic. Pure: no ROS, no clock, no threads.

A message that causes responses adds to what their topics owe; each message on these topics pays one
back, and causes further responses in turn. So the ledger follows a message through a graph of
nodes, without knowing the graph beforehand. DDS may deliver a response before its cause when two
nodes publish them, and a topic is then in credit for a moment. As expected responses form no loop,
all responses have come when no topic owes anything.

A message that nothing caused, such as that of a timer, leaves a topic in credit. `settle` forgets
this credit, or a later message would not be waited for. It cannot tell whether the cause, itself
one too many, is still on its way. So it is restored when a topic before it gets such a message:
else the response to that, which has come already, would be owed for good.
"""

from __future__ import annotations

from typing import Dict, List, Optional, Sequence, Set, Tuple

from udp_bridge.wire.lockstep import JOINED, ExpectedResponse

STAMPS_MAX = 1024
"""Stamps of a joined topic that lack a message on one of its causes; older ones are forgotten."""


class ResponseLedger:
    """What each topic owes.

    Parameters
    ----------
    expected
        The responses, without a loop.
    """

    def __init__(self, expected: Sequence[ExpectedResponse]) -> None:
        self._expected = tuple(dict.fromkeys(expected))
        self._owed = {response.topic: 0 for response in expected}
        self._causes = {
            topic: {each.of for each in expected if each.topic == topic and each.every == JOINED}
            for topic in self._owed
        }
        self._forgotten = dict.fromkeys(self._owed, 0)  # messages that nothing had caused yet
        self._has_begun = False
        self._counts: Dict[ExpectedResponse, int] = {}  # of causes, since the last response
        self._numbers: Dict[str, int] = {}  # of messages without a stamp
        self._stamps: Dict[Tuple[str, int], Set[str]] = {}  # causes of joined topics so far

    def published(self, topic: str, stamp_nanos: Optional[int] = None) -> bool:
        """Count a message that is published in ROS. What came before the first caused nothing.

        Returns whether a node works on it. A node that joins messages only keeps those before the
        last of a stamp, so it does not matter in which order it gets them.
        """
        self._has_begun = True
        return self._count(topic, stamp_nanos)

    def received(self, topic: str, stamp_nanos: Optional[int] = None) -> None:
        """Count a message that ROS published, as a response and as a cause of further ones."""
        if topic not in self._owed:
            return
        if self._owed[topic] <= 0:
            self._restore(topic)
        self._owed[topic] -= 1
        if self._has_begun:
            self._count(topic, stamp_nanos)

    def owing(self) -> str:
        """Return a topic that owes a message; empty when none does."""
        return next((topic for topic, owed in self._owed.items() if owed > 0), "")

    def settle(self) -> List[Tuple[str, int]]:
        """Return the topics with messages that nothing caused, and forget these messages."""
        surplus = [(topic, -owed) for topic, owed in self._owed.items() if owed < 0]
        for topic, count in surplus:
            self._owed[topic] = 0
            self._forgotten[topic] += count
            self._count_anew(topic)
        return surplus

    def forgive(self, topic: str) -> None:
        """Expect no message on a topic for what was published; its publisher counts anew."""
        self._owed[topic] = self._forgotten[topic] = 0
        self._count_anew(topic)
        self._stamps = {key: seen for key, seen in self._stamps.items() if key[0] != topic}

    def caused(self, topics: Set[str]) -> Set[str]:
        """Return topics with all those on which messages of them cause responses, however far."""
        found, size = set(topics), -1
        while len(found) > size:
            size = len(found)
            found |= {response.topic for response in self._expected if response.of in found}
        return found

    def _count(self, topic: str, stamp_nanos: Optional[int]) -> bool:
        if stamp_nanos is None:
            stamp_nanos = self._numbers[topic] = self._numbers.get(topic, 0) + 1
        is_worked_on = False
        for response in self._expected:
            if response.of == topic:
                is_due = self._is_due(response, stamp_nanos)
                self._owed[response.topic] += is_due
                is_worked_on |= is_due or response.every != JOINED
        return is_worked_on

    def _count_anew(self, topic: str) -> None:
        """Count the causes of a topic from now on, as its publisher does."""
        for response in list(self._counts):
            if response.topic == topic:
                del self._counts[response]

    def _restore(self, cause: str) -> None:
        """Give the topics after a topic their forgotten credit again."""
        for topic in self.caused({cause}) - {cause}:
            self._owed[topic] -= self._forgotten[topic]
            self._forgotten[topic] = 0

    def _is_due(self, response: ExpectedResponse, stamp_nanos: int) -> bool:
        if response.every == JOINED:
            return self._is_joined(response, stamp_nanos)
        if response.every < 2:
            return True
        count = self._counts.get(response, 0) + 1
        self._counts[response] = count % response.every
        return count == response.every

    def _is_joined(self, response: ExpectedResponse, stamp_nanos: int) -> bool:
        """Return whether a stamp now has a message of every cause."""
        key = response.topic, stamp_nanos
        seen = self._stamps.setdefault(key, set())
        seen.add(response.of)
        if seen == self._causes[response.topic]:
            del self._stamps[key]
            return True
        if len(self._stamps) > STAMPS_MAX:
            del self._stamps[next(iter(self._stamps))]
        return False
