# SPDX-License-Identifier: Apache-2.0
"""Messages that are next in order are delivered before they are recorded.

The number, stamp and names of a single-part message tell that the rules of `reassembly` will
deliver it. So its user gets it at once. The rules are applied later, to many messages together, and
before any other datagram of a message. A topic is followed while only such messages arrive. The
same holds for a predicted message of several parts that arrives whole; see `receive_slots`.
"""

from __future__ import annotations

from struct import Struct
from typing import Dict, List, NamedTuple, Optional, Tuple, Union

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

from .ordering import MessageKey, key_of

SMALL_TOPICS = 1024
"""Most topics, with their links, that are followed."""
_NAMES_OFFSET = FIXED_SIZE - 2
"""Where the sizes of the names stand, and then the names."""
_FIELDS = Struct("<2xIBBii")
"""seq_number, part_number, parts_max, time_sec, time_nsec."""
_STATE = Struct("<I?3xq")
"""Number of the next message, whether the topic is ordered by stamp, stamp of the last message."""
_WireKey = Tuple[Address, bytes, bytes]
"""Sender, first bytes and names of a header: what all datagrams of a topic and link share."""
TopicRow = Tuple[Union["SmallTopic", "TopicOrigin"], bytearray, int, str, str]
"""A topic with its `_STATE`, msg_type, name and link. Each message of it changes the state."""


def state_of(msg_type: int, key: MessageKey) -> bytearray:
    """Return the state of a topic after a message with this key."""
    number, stamp_nanos = key
    return bytearray(
        _STATE.pack((number + 1) % SEQ_NUMBERS, msg_type in STAMP_ORDERED, stamp_nanos)
    )


class SmallTopic:
    """A topic of one sender with its link, while all its messages are small and in order."""

    __slots__ = ("_table", "_wire_key", "key", "link", "sender")

    def __init__(
        self, table: Dict[_WireKey, TopicRow], wire_key: _WireKey, key: TopicKey, link: str
    ) -> None:
        self._table = table
        self._wire_key = wire_key
        self.key = key
        self.link = link
        self.sender = wire_key[0]

    def end(self) -> None:
        """Follow this topic no longer."""
        self._table.pop(self._wire_key, None)


class TopicOrigin(NamedTuple):
    """Sender, topic and link of messages of several parts."""

    sender: Address
    key: TopicKey
    link: str


class DeliveredMessage(NamedTuple):
    """A message that was delivered and is not recorded yet. It does not keep the body."""

    source: Union[SmallTopic, TopicOrigin]
    key: MessageKey
    body_size: int
    parts: int
    size: int
    """Bytes of its datagrams."""
    now_nanos: int


class WholeMessage(NamedTuple):
    """The upcoming message, of which all parts arrived in order and nothing else did."""

    message: Message
    header: bytes
    """Packed header of its first part."""
    credits_sent: int
    delivered: DeliveredMessage


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
        self.table: Dict[_WireKey, TopicRow] = {}

    def follow(self, header: Header, packed: bytes, sender: Address) -> SmallTopic:
        """Follow the topic of a message that was delivered in order."""
        if len(self.table) >= SMALL_TOPICS:
            self.table.clear()
        msg_type = header.msg_type
        wire_key = sender, packed[:2], packed[_NAMES_OFFSET:]
        topic = SmallTopic(self.table, wire_key, (msg_type, header.topic), header.link)
        state = state_of(msg_type, key_of(header))
        self.table[wire_key] = topic, state, msg_type, header.topic, header.link
        return topic

    def take(self, datagram: Buffer, sender: Address, now_nanos: int) -> Optional[Message]:
        """Return the message of a datagram if it is the next one of a topic that is followed."""
        size = len(datagram)
        if size < SMALLEST_HEADER:
            return None
        offset = datagram[1]
        names = bytes(datagram[_NAMES_OFFSET:offset])
        row = self.table.get((sender, bytes(datagram[:2]), names))
        if row is None or size < offset:
            return None
        topic, state, msg_type, name, link = row
        upcoming, is_stamp_ordered, last_stamp_nanos = _STATE.unpack(state)
        number, part_number, parts_max, sec, nsec = _FIELDS.unpack_from(datagram)
        stamp_nanos = sec * NANOS + nsec
        if (
            number != upcoming
            or part_number
            or parts_max != 1
            or not 0 <= nsec < NANOS
            or (is_stamp_ordered and stamp_nanos < last_stamp_nanos)
        ):
            return None
        _STATE.pack_into(state, 0, (number + 1) % SEQ_NUMBERS, is_stamp_ordered, stamp_nanos)
        body = memoryview(datagram if isinstance(datagram, bytes) else bytes(datagram))[offset:]
        message = Message(msg_type, name, link, stamp_nanos, number, body)
        key = number, stamp_nanos
        self.delivered.append(DeliveredMessage(topic, key, size - offset, 1, size, now_nanos))
        return message

    def close(self) -> None:
        """Follow no topic any longer."""
        self.table.clear()
