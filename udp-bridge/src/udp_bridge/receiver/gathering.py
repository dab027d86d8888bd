# SPDX-License-Identifier: Apache-2.0
"""Messages that are held until the other end says that all of them were sent: lockstep.

What came is compared with what a Barrier or a BarrierReply tells of, by numbers, so that loss,
copies and the order on the way change nothing. Of one sender; no socket, no clock.
"""

from __future__ import annotations

from typing import Callable, Dict, Iterable, List, Optional, Sequence, Tuple

from udp_bridge.wire.header import SEQ_NUMBERS
from udp_bridge.wire.lockstep import SentMessages
from udp_bridge.wire.message import Message, TopicKey
from udp_bridge.wire.types import type_number

HELD_MESSAGES = 65_536
HELD_BYTES = 512 << 20
"""More are dropped as they come: whoever sends so much between two Barriers is at fault."""
_ROOMY = 2
"""A body that lies in a block of more than this many times its size is copied out of it."""
_CLOCK = type_number("Clock")


def _to_nobody(_: Message) -> None:
    """Tell nobody."""


class Gathering:
    """What came from one sender and was not told of yet.

    Parameters
    ----------
    drop
        Called with each message that is let go, for nobody will tell of it any more.
    """

    def __init__(self, drop: Callable[[Message], object] = _to_nobody) -> None:
        self._drop = drop
        self._held: Dict[TopicKey, Dict[int, Message]] = {}
        self._messages = self._bytes = 0
        self._told: Optional[Sequence[SentMessages]] = None  # what `missing` was asked about last
        self._ranges: Dict[TopicKey, SentMessages] = {}  # the same by topic
        self._missing = 0

    def put(self, message: Message) -> None:
        """Hold a message; a copy of one that is held changes nothing."""
        size = memoryview(message.body).nbytes
        of_topic = self._held.setdefault((message.msg_type, message.topic), {})
        is_full = self._messages >= HELD_MESSAGES or self._bytes + size > HELD_BYTES
        if is_full or message.seq_number in of_topic:
            self._drop(message)
            return
        of_topic[message.seq_number] = _compact(message, size)
        self._messages += 1
        self._bytes += size
        sent = self._ranges.get((message.msg_type, message.topic))
        self._missing -= sent is not None and _offset(sent, message.seq_number) < sent.messages

    def missing(self, told: Sequence[SentMessages]) -> int:
        """Return how many of the messages that are told of have not come.

        The count is kept: to ask again about the same object costs nothing.
        """
        if told is not self._told:
            self._told = told
            self._ranges = {(sent.msg_type, sent.topic): sent for sent in told}
            self._missing = sum(sent.messages - len(self._of(sent)) for sent in told)
        return self._missing

    def samples(self, told: Iterable[SentMessages]) -> Iterable[Message]:
        """Return a message that is held of each topic that is told of, where there is one."""
        for sent in told:
            yield from list(self._held.get((sent.msg_type, sent.topic), {}).values())[:1]

    def take(self, told: Iterable[SentMessages]) -> List[Message]:
        """Return the messages that are told of and came, by topic and number; hold the later ones.

        Those of the same topics with numbers before them are let go.
        """
        taken = []
        for sent in told:
            of_topic = self._held.get((sent.msg_type, sent.topic), {})
            taken += [self._let_go(of_topic, number) for number in self._of(sent)]
            for number in list(of_topic):
                if _offset(sent, number) >= SEQ_NUMBERS // 2:
                    self._drop(self._let_go(of_topic, number))
        return taken

    def take_all(self) -> List[Message]:
        """Return all that is held."""
        held = [message for of_topic in self._held.values() for message in of_topic.values()]
        self._held.clear()
        self._messages = self._bytes = 0
        self._told = None
        return held

    def _of(self, sent: SentMessages) -> List[int]:
        """Return the numbers that are held of those in a range, in its order.

        A range may name far more numbers than are held, or the other way round.
        """
        of_topic = self._held.get((sent.msg_type, sent.topic), {})
        if sent.messages < len(of_topic):
            numbers = ((sent.first + index) % SEQ_NUMBERS for index in range(sent.messages))
            return [number for number in numbers if number in of_topic]
        held = (number for number in of_topic if _offset(sent, number) < sent.messages)
        return sorted(held, key=lambda number: _offset(sent, number))

    def _let_go(self, of_topic: Dict[int, Message], number: int) -> Message:
        message = of_topic.pop(number)
        self._told = None
        self._messages -= 1
        self._bytes -= memoryview(message.body).nbytes
        return message


def in_order(messages: Iterable[Message]) -> List[Message]:
    """Return messages as they are to be published: by stamp, type, topic and number; Clock last."""
    return sorted(messages, key=_place)


def _place(message: Message) -> Tuple[int, bool, int, str, int]:
    is_clock = message.msg_type == _CLOCK
    return message.stamp_nanos, is_clock, message.msg_type, message.topic, message.seq_number


def _offset(sent: SentMessages, number: int) -> int:
    return (number - sent.first) % SEQ_NUMBERS


def _compact(message: Message, size: int) -> Message:
    """Return a message that keeps no block much larger than its body from being used again."""
    view = memoryview(message.body)
    if memoryview(view.obj).nbytes <= _ROOMY * size:
        return message
    return message._replace(body=memoryview(bytes(view)))


class Tally:
    """What was sent since it was last told, from how many messages of each topic have left."""

    def __init__(self) -> None:
        self._told: Dict[TopicKey, int] = {}

    def since(self, left: Dict[TopicKey, int]) -> Tuple[SentMessages, ...]:
        """Return what left and was not told yet; `left` counts from the sender's begin."""
        return tuple(
            SentMessages(*key, self._told.get(key, 0) % SEQ_NUMBERS, count - self._told.get(key, 0))
            for key, count in sorted(left.items())
            if count > self._told.get(key, 0)
        )

    def tell(self, left: Dict[TopicKey, int]) -> None:
        """Take note that all of this was told, or that nobody needs to be told."""
        self._told = dict(left)
