# SPDX-License-Identifier: Apache-2.0
"""Small topics: single-part messages that are next in order are delivered before they are recorded.

The number, stamp and names of a datagram tell that the rules of `reassembly` will deliver it. So
its user gets it at once. The rules are applied later, to many messages together, and before any
other datagram of a message. A topic is followed while only such messages arrive.
"""

from __future__ import annotations

from struct import Struct
from typing import Dict, List, NamedTuple, Optional, Tuple

from udp_bridge.wire.header import (
    FIXED_SIZE,
    NANOS,
    SEQ_NUMBERS,
    SMALLEST_HEADER,
    Buffer,
    Header,
)
from udp_bridge.wire.message import Address, Message, TopicKey
from udp_bridge.wire.types import STAMP_ORDERED

SMALL_TOPICS = 1024
"""Most topics, with their links, that are followed."""
_NAMES_OFFSET = FIXED_SIZE - 2
"""Where the sizes of the names stand, and then the names."""
_FIELDS = Struct("<2xIBBii")
"""seq_number, part_number, parts_max, time_sec, time_nsec."""
_WireKey = Tuple[Address, bytes, bytes]
"""Sender, first bytes and names of a header: what all datagrams of a topic and link share."""


class SmallTopic:
    """A topic of one sender with its link, while all its messages are small and in order."""

    __slots__ = (
        "_table",
        "_wire_key",
        "is_stamp_ordered",
        "key",
        "link",
        "next_number",
        "sender",
        "stamp_nanos",
    )

    def __init__(
        self, table: Dict[_WireKey, SmallTopic], wire_key: _WireKey, header: Header
    ) -> None:
        self._table = table
        self._wire_key = wire_key
        self.sender = wire_key[0]
        self.key: TopicKey = (header.msg_type, header.topic)
        self.link = header.link
        self.is_stamp_ordered = header.msg_type in STAMP_ORDERED
        self.next_number = (header.seq_number + 1) % SEQ_NUMBERS
        self.stamp_nanos = header.stamp_nanos
        """Stamp of the last message."""

    def end(self) -> None:
        """Follow this topic no longer."""
        self._table.pop(self._wire_key, None)


class DeliveredMessage(NamedTuple):
    """A message that was delivered and is not recorded yet."""

    topic: SmallTopic
    message: Message
    datagram_size: int
    now_nanos: int


class SmallMessage(NamedTuple):
    """A message of a small topic that a socket has found itself."""

    message: Message
    sender: Address


class SmallTopics:
    """The topics that are followed, and their messages that are not recorded yet.

    A socket may do what `take` does, by `table` and `delivered`.
    """

    def __init__(self) -> None:
        self.delivered: List[DeliveredMessage] = []
        self.table: Dict[_WireKey, SmallTopic] = {}

    def follow(self, header: Header, packed: bytes, sender: Address) -> SmallTopic:
        """Follow the topic of a message that was delivered in order."""
        if len(self.table) >= SMALL_TOPICS:
            self.table.clear()
        wire_key = sender, packed[:2], packed[_NAMES_OFFSET:]
        topic = self.table[wire_key] = SmallTopic(self.table, wire_key, header)
        return topic

    def take(self, datagram: Buffer, sender: Address, now_nanos: int) -> Optional[Message]:
        """Return the message of a datagram if it is the next one of a topic that is followed."""
        size = len(datagram)
        if size < SMALLEST_HEADER:
            return None
        offset = datagram[1]
        names = bytes(datagram[_NAMES_OFFSET:offset])
        topic = self.table.get((sender, bytes(datagram[:2]), names))
        if topic is None or size < offset:
            return None
        number, part_number, parts_max, sec, nsec = _FIELDS.unpack_from(datagram)
        stamp_nanos = sec * NANOS + nsec
        if (
            number != topic.next_number
            or part_number
            or parts_max != 1
            or not 0 <= nsec < NANOS
            or (topic.is_stamp_ordered and stamp_nanos < topic.stamp_nanos)
        ):
            return None
        topic.next_number = (number + 1) % SEQ_NUMBERS
        topic.stamp_nanos = stamp_nanos
        msg_type, name = topic.key
        body = memoryview(datagram if isinstance(datagram, bytes) else bytes(datagram))[offset:]
        message = Message(msg_type, name, topic.link, stamp_nanos, number, body)
        self.delivered.append(DeliveredMessage(topic, message, size, now_nanos))
        return message

    def close(self) -> None:
        """Follow no topic any longer."""
        self.table.clear()
