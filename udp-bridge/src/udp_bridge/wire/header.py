# SPDX-License-Identifier: Apache-2.0
"""The header of a datagram: bytes to `Header` and back.

Two errors, by cause: `Refused` is the peer's fault (a bad datagram, to be counted and dropped),
`BadMessage` is the caller's. For any bytes, `parse` returns or raises `Refused`.
"""

from __future__ import annotations

from functools import lru_cache
from struct import Struct
from typing import NamedTuple, Tuple, Union

from .types import MSG_TYPES, SEALED

# The paper declares every field signed; unsigned they are the same bytes up to 127, and a
# message may have 255 parts instead of 127. Only time stays signed.
_FIXED = Struct("<BBIBBiiBB")
_NUMBER_TO_STAMP = Struct("<IBBii")
_NUMBER_OFFSET = 2
TIME_END = _NUMBER_OFFSET + _NUMBER_TO_STAMP.size
FIXED_SIZE = _FIXED.size
"""Bytes of the fields before the names: 18."""
_NAMES_OFFSET = 2  # behind their sizes
_SIZES_OFFSET = FIXED_SIZE - _NAMES_OFFSET
_NAMES_KEPT = 1024
"""Parsed header ends that are cached, because most of them recur."""
SMALLEST_HEADER = 20
LARGEST_HEADER = 252
"""The largest multiple of 4 that a byte can hold."""
NAMES_MAX = LARGEST_HEADER - FIXED_SIZE
"""Bytes that topic and link may take together: 234."""
PARTS_MAX = 255
PART_NUMBER_OFFSET = 6
PARTS_MAX_OFFSET = 7
TIME_OFFSET = 8
SEQ_NUMBERS = 1 << 32
NANOS = 1_000_000_000

SIGNED_PARTS_MAX = 127
SIGNED_LARGEST_HEADER = 124
SIGNED_SEQ_NUMBERS = 1 << 31

Buffer = Union[bytes, bytearray, memoryview]


class Refused(Exception):
    """A datagram breaks a rule of the protocol; `reason` is the name of its counter."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


class BadMessage(ValueError):
    """The caller can't send a message; the text names the field and its limit."""


class Header(NamedTuple):
    """The fields of one datagram's header; the sizes on the wire are derived from them."""

    msg_type: int
    seq_number: int
    """Number of the message modulo 2**32, per sender, type and topic."""
    part_number: int
    parts_max: int
    time_sec: int
    """Stamp of the message, POSIX seconds."""
    time_nsec: int
    """Nanoseconds of the stamp, 0..999 999 999."""
    topic: str = ""
    link: str = ""

    @property
    def stamp_nanos(self) -> int:
        """The stamp in nanoseconds since the POSIX epoch."""
        return self.time_sec * NANOS + self.time_nsec

    def pack(self, *, signed_peer: bool = False) -> bytes:
        """Return the header's bytes, padded to a multiple of 4.

        Parameters
        ----------
        signed_peer
            Keep within the limits of a peer that reads the counts as signed integers.

        Raises
        ------
        BadMessage
            When a field is outside its range or the names are too long.
        """
        topic = _encode("topic", self.topic)
        link = _encode("link", self.link)
        names = len(topic) + len(link)
        size = header_size(names)
        largest = SIGNED_LARGEST_HEADER if signed_peer else LARGEST_HEADER
        if size > largest:
            raise BadMessage(
                f"topic {_elided(self.topic)} and link {_elided(self.link)} take {names} bytes"
                f" together; at most {largest - FIXED_SIZE} fit into a header"
            )
        parts = SIGNED_PARTS_MAX if signed_peer else PARTS_MAX
        seq_numbers = SIGNED_SEQ_NUMBERS if signed_peer else SEQ_NUMBERS
        if not (
            0 <= self.msg_type <= 255
            and 0 <= self.seq_number < seq_numbers
            and 0 <= self.part_number < self.parts_max <= parts
            and -(1 << 31) <= self.time_sec < 1 << 31
            and 0 <= self.time_nsec < NANOS
        ):  # test again, field by field, for the error's text
            _check("msg_type", self.msg_type, 0, 255)
            _check("seq_number", self.seq_number, 0, seq_numbers - 1)
            _check("parts_max", self.parts_max, 1, parts)
            _check("part_number", self.part_number, 0, self.parts_max - 1)
            _check("time_sec", self.time_sec, -(1 << 31), (1 << 31) - 1)
            _check("time_nsec", self.time_nsec, 0, NANOS - 1)
        fixed = _FIXED.pack(
            self.msg_type,
            size,
            self.seq_number,
            self.part_number,
            self.parts_max,
            self.time_sec,
            self.time_nsec,
            len(topic),
            len(link),
        )
        return b"".join((fixed, topic, link, bytes(size - FIXED_SIZE - names)))

    def __str__(self) -> str:
        text = f"{type_label(self.msg_type)} #{self.seq_number}"
        if self.parts_max != 1:
            text += f" part {self.part_number} of {self.parts_max}"
        text += f" {_elided(self.topic)}"
        if self.link:
            text += f" link {_elided(self.link)}"
        return f"{text} at {self.time_sec}.{self.time_nsec:09d}"


def parse(datagram: Buffer) -> Tuple[Header, int]:
    """Return the header of a datagram and the offset at which its body begins.

    Raises
    ------
    Refused
        For every datagram that breaks the format; nothing else is raised.
    """
    size = len(datagram)
    if size < FIXED_SIZE:
        raise Refused("short" if size else "empty")
    fields = _FIXED.unpack_from(datagram)
    msg_type, offset, seq_number, part_number, parts_max, sec, nsec, _, _ = fields
    if offset < SMALLEST_HEADER:
        raise Refused("header_size_small")
    if offset > size:
        raise Refused("header_size_past_end")
    if offset % 4:
        raise Refused("header_size_unaligned")
    if parts_max == 0:
        raise Refused("parts_zero")
    if part_number >= parts_max:
        raise Refused("part_past_parts")
    if nsec < 0:
        raise Refused("nsec_negative")
    if nsec >= NANOS:
        raise Refused("nsec_too_big")
    topic, link = _names(bytes(datagram[_SIZES_OFFSET:offset]))
    if msg_type not in MSG_TYPES:
        raise Refused("sealed" if msg_type == SEALED else "unknown_type")
    return Header(msg_type, seq_number, part_number, parts_max, sec, nsec, topic, link), offset


def header_size(names: int) -> int:
    """Return the size of a header whose names take so many bytes together."""
    size = FIXED_SIZE + names
    return size + -size % 4


def is_stamp(stamp_nanos: int) -> bool:
    """Return whether a header can carry a stamp."""
    return -(1 << 31) * NANOS <= stamp_nanos < (1 << 31) * NANOS


def restamped(packed: bytes, seq_number: int, stamp_nanos: int) -> bytes:
    """Return a copy of the header of part 0 with another number and stamp.

    Parameters
    ----------
    packed
        The header to copy.
    seq_number, stamp_nanos
        The new values; their ranges are not checked.
    """
    sec, nsec = divmod(stamp_nanos, NANOS)
    anew = _NUMBER_TO_STAMP.pack(seq_number, 0, packed[PARTS_MAX_OFFSET], sec, nsec)
    return packed[:_NUMBER_OFFSET] + anew + packed[TIME_END:]


def type_label(msg_type: int) -> str:
    """Return the name of a type, or a text with an unknown number."""
    row = MSG_TYPES.get(msg_type)
    return row.name if row else f"type {msg_type}"


@lru_cache(maxsize=_NAMES_KEPT)
def _names(rest: bytes) -> Tuple[str, str]:
    """Return topic and link of a header's end, which begins with their sizes."""
    topic_end = _NAMES_OFFSET + rest[0]
    link_end = topic_end + rest[1]
    if topic_end > len(rest):
        raise Refused("topic_past_header")
    if link_end > len(rest):
        raise Refused("link_past_header")
    if len(rest) - link_end > 3:
        raise Refused("header_size_large")
    return _decode("topic", rest[_NAMES_OFFSET:topic_end]), _decode(
        "link", rest[topic_end:link_end]
    )


def _decode(field: str, name: bytes) -> str:
    try:
        text = name.decode("utf-8")
    except UnicodeDecodeError:
        raise Refused(field + "_not_utf8") from None
    if "\0" in text:
        raise Refused(field + "_nul")
    return text


def _encode(field: str, name: str) -> bytes:
    if "\0" in name:
        raise BadMessage(f"{field} {_elided(name)} holds a NUL character")
    try:
        return name.encode("utf-8")
    except UnicodeEncodeError:
        raise BadMessage(f"{field} {_elided(name)} can't be written as UTF-8") from None


def _check(field: str, value: int, lowest: int, highest: int) -> None:
    if not lowest <= value <= highest:
        raise BadMessage(f"{field} is {value}; {lowest}..{highest} is possible")


def _elided(name: str, limit: int = 40) -> str:
    """Return a name for a log line: quoted, unprintable characters escaped, cut to `limit`."""
    return ascii(name) if len(name) <= limit else ascii(name[: limit - 3] + "...")
