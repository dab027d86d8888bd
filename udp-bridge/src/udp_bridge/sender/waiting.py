# SPDX-License-Identifier: Apache-2.0
"""Messages that wait to be sent: small ones by order of arrival, large ones in turn by topic."""

from __future__ import annotations

from collections import OrderedDict, deque
from typing import Deque, Dict, List, Mapping, Tuple

from udp_bridge.wire.fragments import flat
from udp_bridge.wire.message import Message, TopicKey

SMALL_PER_TOPIC = 512
"""Most single-part messages of a topic that wait; more than a second of a 400 Hz topic."""
QueueLimits = Mapping[TopicKey, int]
"""Body bytes of a topic's large messages that may wait; only the newest one of other topics."""
LinkKey = Tuple[int, str, str]
"""msg_type, topic and link."""


class SmallMessages:
    """Waiting single-part messages by order of arrival, bounded by topic."""

    def __init__(self) -> None:
        self.messages: OrderedDict[int, Message] = OrderedDict()
        """Waiting messages by order of arrival."""
        self._of_topic: Dict[TopicKey, Deque[int]] = {}
        self._arrivals = 0

    def put(self, message: Message) -> List[Message]:
        """Add a message; return those that it supersedes."""
        superseded = []
        waiting = self._of_topic.setdefault((message.msg_type, message.topic), deque())
        if len(waiting) >= SMALL_PER_TOPIC:
            superseded.append(self.messages.pop(waiting.popleft()))
        self._arrivals += 1
        waiting.append(self._arrivals)
        self.messages[self._arrivals] = message
        return superseded

    def pop(self) -> Message:
        """Remove and return the oldest message."""
        _, message = self.messages.popitem(last=False)
        key = (message.msg_type, message.topic)
        self._of_topic[key].popleft()
        if not self._of_topic[key]:
            del self._of_topic[key]
        return message


class LargeMessages:
    """Waiting multi-part messages; topics take turns.

    Of a topic and link only the newest message waits, or as many as fit into `limits`.
    """

    def __init__(self, limits: QueueLimits) -> None:
        self._limits = limits
        self.of_link: OrderedDict[LinkKey, Deque[Message]] = OrderedDict()
        """Waiting messages; the topic whose turn it is comes last."""

    def put(self, message: Message) -> List[Message]:
        """Add a message; return those that it supersedes."""
        key = (message.msg_type, message.topic, message.link)
        waiting = self.of_link.setdefault(key, deque())
        waiting.append(message)
        superseded = []
        limit = self._limits.get(key[:2], 0)
        while len(waiting) > 1 and sum(flat(one.body).nbytes for one in waiting) > limit:
            superseded.append(waiting.popleft())
        return superseded

    def pop(self) -> Message:
        """Remove and return the message whose turn it is."""
        key, waiting = self.of_link.popitem(last=False)
        message = waiting.popleft()
        if waiting:
            self.of_link[key] = waiting  # behind other topics
        return message
