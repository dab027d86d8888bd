# SPDX-License-Identifier: Apache-2.0
"""What waits for one destination and has no number yet: small messages, and large ones.

Of small ones (a single part) all wait, in order, up to a bound; of the large ones of a topic and
link only the newest, or as many as fit into the bytes that may wait. What goes when is `sending`'s.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from typing import Deque, Dict, List, Mapping, Optional, Tuple

from udp_bridge.wire.message import Message, TopicKey

SMALL_WAITING_PER_TOPIC = 512
"""Single-part messages of a topic that wait; more than a second of a 400 Hz topic."""

WaitingTable = Mapping[TopicKey, int]
"""Body bytes that may wait of a topic's large messages; of one that is not in it the newest."""
_LargeKey = Tuple[int, str, str]


class SmallWaiting:
    """Single-part messages by order of arrival."""

    def __init__(self) -> None:
        self._messages: OrderedDict[int, Message] = OrderedDict()
        self._of: Dict[TopicKey, Deque[int]] = {}
        self._arrivals = 0

    def __bool__(self) -> bool:
        return bool(self._messages)

    def put(self, message: Message) -> Optional[Message]:
        """Add a message; return the one that gives way to it, if one has to."""
        oldest = None
        waiting = self._of.setdefault((message.msg_type, message.topic), deque())
        if len(waiting) >= SMALL_WAITING_PER_TOPIC:
            oldest = self._messages.pop(waiting.popleft())
        self._arrivals += 1
        waiting.append(self._arrivals)
        self._messages[self._arrivals] = message
        return oldest

    def pop(self) -> Message:
        """Return the oldest message, which no longer waits."""
        _, message = self._messages.popitem(last=False)
        key = (message.msg_type, message.topic)
        self._of[key].popleft()
        if not self._of[key]:
            del self._of[key]
        return message


class LargeWaiting:
    """Messages of several parts, topics in turn.

    Parameters
    ----------
    most_bytes
        Of each link of a topic; the newest message waits in any case.
    """

    def __init__(self, most_bytes: WaitingTable) -> None:
        self._most_bytes = most_bytes
        self._of: OrderedDict[_LargeKey, Deque[Message]] = OrderedDict()

    def __bool__(self) -> bool:
        return bool(self._of)

    def put(self, message: Message) -> List[Message]:
        """Add a message; return those that it supersedes."""
        key = (message.msg_type, message.topic, message.link)
        waiting = self._of.setdefault(key, deque())
        waiting.append(message)
        superseded = []
        most_bytes = self._most_bytes.get(key[:2], 0)
        while len(waiting) > 1 and _body_bytes(waiting) > most_bytes:
            superseded.append(waiting.popleft())
        return superseded

    def pop(self) -> Message:
        """Return the message whose turn it is, which no longer waits."""
        key, waiting = self._of.popitem(last=False)
        message = waiting.popleft()
        if waiting:
            self._of[key] = waiting  # behind other topics
        return message


def _body_bytes(messages: Deque[Message]) -> int:
    return sum(memoryview(message.body).nbytes for message in messages)
