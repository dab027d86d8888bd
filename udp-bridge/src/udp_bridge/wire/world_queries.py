# SPDX-License-Identifier: Apache-2.0
"""Bodies of WorldQuery and WorldReply in Control (type 64), to the byte.

ROS asks for the run's world, and changes it, by texts whose meaning is not the bridge's. The text
stays compressed in a body: who reads it decompresses it, once, so that a datagram of a stranger
costs no more than another one.
"""

from __future__ import annotations

import zlib
from struct import Struct
from typing import NamedTuple, Tuple

from .fragments import LARGEST_DATAGRAM
from .header import SMALLEST_HEADER, BadMessage, Buffer, Refused
from .seal import OVERHEAD

_HEAD = Struct("<B7xQ")

TEXT_BYTES = 4 << 20
"""Bytes of a decompressed text, at most."""
PACKED_BYTES = LARGEST_DATAGRAM - SMALLEST_HEADER - OVERHEAD - _HEAD.size
"""Bytes of a compressed text, at most: the body fits into one datagram, sealed or not."""


class WorldQuery(NamedTuple):
    """Kind 10: a query to the world, repeated until it is answered; topic and link are empty."""

    number: int
    """As that of a RunCommand, and counted with them: a query is executed once."""
    packed_text: bytes
    """See `pack_text`."""

    def pack(self) -> bytes:
        """Return the body: 16 bytes and the text."""
        return _HEAD.pack(10, self.number) + self.packed_text

    @classmethod
    def parse(cls, body: Buffer) -> WorldQuery:
        """Return the parsed body, or raise `Refused`."""
        return cls(*_parsed(body))


class WorldReply(NamedTuple):
    """Kind 11: the answer to a query; topic and link are empty."""

    number: int
    """The query's."""
    packed_text: bytes
    """See `pack_text`."""

    def pack(self) -> bytes:
        """Return the body: 16 bytes and the text."""
        return _HEAD.pack(11, self.number) + self.packed_text

    @classmethod
    def parse(cls, body: Buffer) -> WorldReply:
        """Return the parsed body, or raise `Refused`."""
        return cls(*_parsed(body))


def pack_text(text: str) -> bytes:
    """Return a text as a body carries it: UTF-8, compressed by zlib.

    Raises
    ------
    BadMessage
        When no peer would accept the text, because of its size or a NUL in it.
    """
    plain = text.encode()
    if len(plain) > TEXT_BYTES:
        raise BadMessage(f"the text has {len(plain)} bytes; at most {TEXT_BYTES} are possible")
    if "\0" in text:
        raise BadMessage("the text contains NUL")
    packed = zlib.compress(plain)
    if len(packed) > PACKED_BYTES:
        raise BadMessage(
            f"the text has {len(plain)} bytes, compressed {len(packed)}; "
            f"one datagram holds {PACKED_BYTES}"
        )
    return packed


def unpack_text(packed: bytes) -> str:
    """Return the text of a body. Decompression ends at the limit.

    Raises
    ------
    Refused
        When the text is larger than the limit (`body_size`), or the bytes are not one whole zlib
        stream of UTF-8 without NUL (`body_value`).
    """
    stream = zlib.decompressobj()
    try:
        plain = stream.decompress(packed, TEXT_BYTES + 1)
        if len(plain) > TEXT_BYTES:
            raise Refused("body_size")
        text = plain.decode()
    except (zlib.error, UnicodeDecodeError):
        raise Refused("body_value") from None
    if not stream.eof or stream.unused_data or "\0" in text:
        raise Refused("body_value")
    return text


def _parsed(body: Buffer) -> Tuple[int, bytes]:
    if len(body) < _HEAD.size:
        raise Refused("body_size")
    return _HEAD.unpack_from(body)[1], bytes(body[_HEAD.size :])
