# SPDX-License-Identifier: Apache-2.0
"""Barrier buffer: holds messages until a Barrier announces that all of them were sent (lockstep).

Messages are compared with the announced number ranges, so loss, duplicates and reordering do not
change the result. One buffer per sender; no socket, no clock.
"""

from __future__ import annotations

from typing import Callable, Dict, Iterable, List, Optional, Sequence, Tuple

from udp_bridge.wire.header import SEQ_NUMBERS
from udp_bridge.wire.lockstep import SentMessages
from udp_bridge.wire.message import Message, TopicKey
from udp_bridge.wire.types import type_number

HELD_MESSAGES = 65_536
HELD_BYTES = 512 << 20
"""Further messages are dropped: a correct sender does not send more between two Barriers."""
_MAX_WASTE = 2
"""A body in a block of more than this many times its size is copied."""
_CLOCK = type_number("Clock")


def _ignore(_: Message) -> None:
    """Do nothing."""


class BarrierBuffer:
    """Messages of one sender that no Barrier has released yet.

    Parameters
    ----------
    on_drop
        Called with each message that is discarded because no Barrier will release it.
    """

    def __init__(self, on_drop: Callable[[Message], object] = _ignore) -> None:
        self._on_drop = on_drop
        self._held: Dict[TopicKey, Dict[int, Message]] = {}
        self._messages = self._bytes = 0
        self._announced: Optional[Sequence[SentMessages]] = None  # the last argument of `missing`
        self._ranges: Dict[TopicKey, SentMessages] = {}  # the same by topic
        self._missing = 0

    def put(self, message: Message) -> None:
        """Hold a message; a duplicate is dropped."""
        size = memoryview(message.body).nbytes
        of_topic = self._held.setdefault((message.msg_type, message.topic), {})
        is_full = self._messages >= HELD_MESSAGES or self._bytes + size > HELD_BYTES
        if is_full or message.seq_number in of_topic:
            self._on_drop(message)
            return
        of_topic[message.seq_number] = _compact(message, size)
        self._messages += 1
        self._bytes += size
        sent = self._ranges.get((message.msg_type, message.topic))
        self._missing -= sent is not None and _offset(sent, message.seq_number) < sent.messages

    def missing(self, announced: Sequence[SentMessages]) -> int:
        """Return how many of the announced messages have not arrived.

        The count is cached: another call with the same object is free.
        """
        if announced is not self._announced:
            self._announced = announced
            self._ranges = {(sent.msg_type, sent.topic): sent for sent in announced}
            self._missing = sum(sent.messages - len(self._held_of(sent)) for sent in announced)
        return self._missing

    def samples(self, announced: Iterable[SentMessages]) -> Iterable[Message]:
        """Return one held message of each announced topic that has any."""
        for sent in announced:
            yield from list(self._held.get((sent.msg_type, sent.topic), {}).values())[:1]

    def take(self, announced: Iterable[SentMessages]) -> List[Message]:
        """Return the announced messages that arrived, by topic and number; keep later ones.

        Earlier messages of the same topics are dropped.
        """
        taken = []
        for sent in announced:
            of_topic = self._held.get((sent.msg_type, sent.topic), {})
            taken += [self._remove(of_topic, number) for number in self._held_of(sent)]
            for number in list(of_topic):
                if _offset(sent, number) >= SEQ_NUMBERS // 2:
                    self._on_drop(self._remove(of_topic, number))
        return taken

    def take_all(self) -> List[Message]:
        """Return all held messages."""
        held = [message for of_topic in self._held.values() for message in of_topic.values()]
        self._held.clear()
        self._messages = self._bytes = 0
        self._announced = None
        return held

    def _held_of(self, sent: SentMessages) -> List[int]:
        """Return the held numbers within a range, in its order.

        Iterates over whichever is shorter, the range or what is held.
        """
        of_topic = self._held.get((sent.msg_type, sent.topic), {})
        if sent.messages < len(of_topic):
            numbers = ((sent.first + index) % SEQ_NUMBERS for index in range(sent.messages))
            return [number for number in numbers if number in of_topic]
        held = (number for number in of_topic if _offset(sent, number) < sent.messages)
        return sorted(held, key=lambda number: _offset(sent, number))

    def _remove(self, of_topic: Dict[int, Message], number: int) -> Message:
        message = of_topic.pop(number)
        self._announced = None
        self._messages -= 1
        self._bytes -= memoryview(message.body).nbytes
        return message


def in_order(messages: Iterable[Message]) -> List[Message]:
    """Sort messages for publication: by stamp, type, topic and number; Clock last of its stamp."""
    return sorted(messages, key=_publication_order)


def _publication_order(message: Message) -> Tuple[int, bool, int, str, int]:
    is_clock = message.msg_type == _CLOCK
    return message.stamp_nanos, is_clock, message.msg_type, message.topic, message.seq_number


def _offset(sent: SentMessages, number: int) -> int:
    return (number - sent.first) % SEQ_NUMBERS


def _compact(message: Message, size: int) -> Message:
    """Return a message that does not keep a block much larger than its body in use."""
    view = memoryview(message.body)
    if memoryview(view.obj).nbytes <= _MAX_WASTE * size:
        return message
    return message._replace(body=memoryview(bytes(view)))


class AnnouncedCounts:
    """Number of messages per topic that earlier Barriers have announced."""

    def __init__(self) -> None:
        self._announced: Dict[TopicKey, int] = {}

    def unannounced(self, sent: Dict[TopicKey, int]) -> Tuple[SentMessages, ...]:
        """Return the ranges to announce; `sent` counts messages since the sender started."""
        return tuple(
            SentMessages(*key, self._announced.get(key, 0) % SEQ_NUMBERS, new)
            for key, count in sorted(sent.items())
            if (new := count - self._announced.get(key, 0)) > 0
        )

    def mark_announced(self, sent: Dict[TopicKey, int]) -> None:
        """Record that all of these were announced, or need not be."""
        self._announced = dict(sent)
