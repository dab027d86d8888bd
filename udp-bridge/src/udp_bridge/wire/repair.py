# SPDX-License-Identifier: Apache-2.0
"""Bodies of the repair messages, to the byte: Resend (type 65) and Repair (type 66).

Each class packs and parses itself. An invalid body raises `Refused` (`body_size` or `body_value`).
"""

from __future__ import annotations

from struct import Struct
from typing import NamedTuple, Tuple, Union

from .header import Buffer, Refused
from .types import ROS_TYPES

_OFFER = Struct("<BBBxI")
_REQUEST = Struct("<BBBBI")
_SYMBOL = Struct("<BBBxI")

SYMBOL_PREFIX = _SYMBOL.size
"""Bytes before the symbol in the body of a Repair message: 8."""
SYMBOL_UNIT = 8
"""Symbols are multiples of this."""
WHOLE_MAX = 64
"""Whole messages that one request may request."""


class Offer(NamedTuple):
    """Kind 0 of Resend: all parts of the message that the header names have been sent.

    The header has the topic, seq_number and time of the newest message; the link is empty.
    """

    msg_type: int
    parts_max: int
    """Of the newest message."""
    limit_ms: int
    """Greatest age of a message that may be requested."""

    def pack(self) -> bytes:
        """Return the 8 bytes of the body."""
        return _OFFER.pack(0, self.msg_type, self.parts_max, self.limit_ms)


class Request(NamedTuple):
    """Kind 1 of Resend: these parts of the message that the header names are missing.

    Or, with parts_max 0, `messages` whole messages from the header's seq_number on, of which
    nothing arrived; then the header's time has no meaning.
    """

    msg_type: int
    parts_max: int
    messages: int
    goodput: int
    """Bytes that arrived from this sender within the last second, headers included."""
    parts: Tuple[int, ...] = ()
    """Part numbers, ascending; empty when whole messages are requested."""

    def pack(self) -> bytes:
        """Return the body: 8 bytes and a bitmap of the parts."""
        fixed = _REQUEST.pack(1, self.msg_type, self.parts_max, self.messages, self.goodput)
        bits = sum(1 << part for part in self.parts)
        return fixed + bits.to_bytes(-(-self.parts_max // 8), "little")


def parse_resend(body: Buffer) -> Union[Offer, Request]:
    """Return the body of a Resend message, whichever kind it is, or raise `Refused`."""
    if len(body) < _OFFER.size:
        raise Refused("body_size")
    kind, msg_type, parts_max, count, number = _REQUEST.unpack_from(body)
    if kind > 1 or msg_type not in ROS_TYPES:
        raise Refused("body_value")
    bitmap = bytes(body[_REQUEST.size :])
    if len(bitmap) != (-(-parts_max // 8) if kind else 0):
        raise Refused("body_size")
    if not kind:
        if not parts_max:
            raise Refused("body_value")
        return Offer(msg_type, parts_max, number)
    bits = int.from_bytes(bitmap, "little")
    most = 1 if parts_max else WHOLE_MAX
    if not 1 <= count <= most or bits >> parts_max or bool(bits) != bool(parts_max):
        raise Refused("body_value")
    return Request(msg_type, parts_max, count, number, parts_of(bitmap))


def parts_of(bitmap: bytes) -> Tuple[int, ...]:
    """Return the numbers of the set bits."""
    bits = int.from_bytes(bitmap, "little")
    return tuple(part for part in range(8 * len(bitmap)) if bits >> part & 1)


class Symbol(NamedTuple):
    """The fields before a repair symbol: the message that it repairs, and the code.

    The header has the message's topic, link, seq_number and time; its part_number is the
    symbol's index among the parts_max that were sent.
    """

    msg_type: int
    parts_max: int
    """Of the message; its parts are the source symbols."""
    code: int
    body_size: int

    def pack(self) -> bytes:
        """Return the 8 bytes before the symbol."""
        return _SYMBOL.pack(*self)


def parse_symbol(body: Buffer) -> Tuple[Symbol, memoryview]:
    """Return the body of a Repair message and the symbol in it, or raise `Refused`."""
    if len(body) <= SYMBOL_PREFIX or len(body) % SYMBOL_UNIT:
        raise Refused("body_size")
    symbol = Symbol(*_SYMBOL.unpack_from(body))
    size = len(body) - SYMBOL_PREFIX
    if symbol.msg_type not in ROS_TYPES or symbol.parts_max != -(-symbol.body_size // size):
        raise Refused("body_value")
    if symbol.parts_max == 0:
        raise Refused("body_value")
    return symbol, memoryview(body)[SYMBOL_PREFIX:]
