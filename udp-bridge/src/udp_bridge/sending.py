# SPDX-License-Identifier: Apache-2.0
"""What waits to be sent, and which datagram goes next. No socket, no thread, no clock.

Single-part messages (clock, commands, IMU) go before parts of large ones; of the large ones of
a topic only the newest waits, behind the one that is on its way. A message gets its number
when it leaves, so that what was superseded here leaves no gap there.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from typing import Deque, Dict, Iterator, List, NamedTuple, Optional, Tuple

from .flow import DatagramKey, Pacer
from .fragments import DatagramSize, check_datagram_size, fragments, plan
from .header import SEQ_NUMBERS, SIGNED_SEQ_NUMBERS
from .message import Message

SMALL_WAITING_PER_TOPIC = 512
"""Single-part messages of a topic that wait; more than a second of a 400 Hz topic."""
NUMBERED_TOPICS = 4096
"""Topics whose numbers are remembered; one that is forgotten begins at 0 like a restart."""

Address = Tuple[str, int]
_TopicKey = Tuple[int, str]
_LargeKey = Tuple[int, str, str]


class Datagram(NamedTuple):
    """What is to be sent next: `sendmsg([header, part], [], 0, to)`."""

    header: bytes
    part: memoryview
    to: Address
    is_last: bool
    """Whether its message is sent with it."""


class Numbering:
    """Gives each message the next seq_number of its type and topic."""

    def __init__(self, *, signed_peer: bool = False) -> None:
        self._modulus = SIGNED_SEQ_NUMBERS if signed_peer else SEQ_NUMBERS
        self._next: OrderedDict[_TopicKey, int] = OrderedDict()

    def next(self, msg_type: int, topic: str) -> int:
        """Return the number of the next message, counted from 0."""
        key = (msg_type, topic)
        number = self._next.pop(key, 0)
        self._next[key] = (number + 1) % self._modulus
        if len(self._next) > NUMBERED_TOPICS:
            self._next.popitem(last=False)
        return number


class Outbox:
    """All that waits for one destination."""

    def __init__(
        self, to: Address, datagram_size: DatagramSize, *, signed_peer: bool = False
    ) -> None:
        self.to = to
        self.pacer = Pacer()
        self.superseded = 0
        """Messages dropped here because newer ones of their topic came."""
        self._datagram_size = check_datagram_size(datagram_size)
        self._signed_peer = signed_peer
        self._numbering = Numbering(signed_peer=signed_peer)
        self._small: OrderedDict[int, Message] = OrderedDict()  # by order of arrival
        self._small_of: Dict[_TopicKey, Deque[int]] = {}
        self._arrivals = 0
        self._large: OrderedDict[_LargeKey, Message] = OrderedDict()
        self._current: Optional[Iterator[Tuple[bytes, memoryview]]] = None
        self._message: Optional[Message] = None  # the one on its way, with its number
        self._part: Optional[Tuple[bytes, memoryview]] = None  # its next datagram
        self._part_number = 0

    def put(self, message: Message) -> None:
        """Queue a message; its seq_number is given later.

        Raises
        ------
        BadMessage
            When it can't be sent to this destination (`TooLarge`: at no datagram size).
        """
        cut = plan(message, self._datagram_size, signed_peer=self._signed_peer)
        if cut.parts_max == 1:
            self._put_small(message)
        else:
            key = (message.msg_type, message.topic, message.link)
            self.superseded += key in self._large
            self._large[key] = message

    def take(self, now_nanos: int) -> Optional[Datagram]:
        """Return the datagram to send now, if one may go."""
        if self._small:
            return self._take_small()
        part = self._next_part()
        if part is None or not self.pacer.may_send(_size(part), now_nanos):
            return None
        assert self._message is not None
        assert self._current is not None
        message = self._message
        key = DatagramKey(message.msg_type, message.topic, message.seq_number, self._part_number)
        self.pacer.sent(key, _size(part), now_nanos)
        self._part = next(self._current, None)
        self._part_number += 1
        return Datagram(part[0], part[1], self.to, is_last=self._part is None)

    def next_wake(self, now_nanos: int) -> Optional[int]:
        """Return when to call `take` again if nothing happens; None when nothing waits."""
        part = self._next_part()
        if self._small:
            return now_nanos
        return None if part is None else self.pacer.next_wake(_size(part), now_nanos)

    def _put_small(self, message: Message) -> None:
        waiting = self._small_of.setdefault((message.msg_type, message.topic), deque())
        if len(waiting) >= SMALL_WAITING_PER_TOPIC:
            del self._small[waiting.popleft()]
            self.superseded += 1
        self._arrivals += 1
        waiting.append(self._arrivals)
        self._small[self._arrivals] = message

    def _take_small(self) -> Datagram:
        _, message = self._small.popitem(last=False)
        key = (message.msg_type, message.topic)
        self._small_of[key].popleft()
        if not self._small_of[key]:
            del self._small_of[key]
        ((header, part),) = self._fragments(message)[1]
        return Datagram(header, part, self.to, is_last=True)

    def _next_part(self) -> Optional[Tuple[bytes, memoryview]]:
        if self._part is None and self._large:
            _, message = self._large.popitem(last=False)
            self._message, self._current = self._fragments(message)
            self._part = next(self._current)
            self._part_number = 0
        return self._part

    def _fragments(self, message: Message) -> Tuple[Message, Iterator[Tuple[bytes, memoryview]]]:
        number = self._numbering.next(message.msg_type, message.topic)
        message = message._replace(seq_number=number)
        cut = fragments(message, self._datagram_size, signed_peer=self._signed_peer)
        return message, cut


def take_in_turn(outboxes: List[Outbox], now_nanos: int) -> Optional[Datagram]:
    """Return the datagram to send now from any outbox; whose turn it was goes to the end."""
    for index, outbox in enumerate(outboxes):
        datagram = outbox.take(now_nanos)
        if datagram is not None:
            outboxes.append(outboxes.pop(index))
            return datagram
    return None


def _size(part: Tuple[bytes, memoryview]) -> int:
    return len(part[0]) + part[1].nbytes
