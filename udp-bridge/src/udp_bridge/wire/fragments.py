# SPDX-License-Identifier: Apache-2.0
"""Fragmentation: the part size of a message, and the header of each part.

A body is sliced, never copied: the caller sends header and slice as one datagram.
"""

from __future__ import annotations

from typing import Iterator, NamedTuple, Tuple, Union

from .header import PART_NUMBER_OFFSET, PARTS_MAX, SIGNED_PARTS_MAX, BadMessage, type_label
from .message import Message
from .repair import SYMBOL_PREFIX, SYMBOL_UNIT
from .types import CONTROL

SMALLEST_DATAGRAM = 256
"""Leaves 4 bytes for the body behind the largest header."""
LARGEST_DATAGRAM = 65507
"""What IPv4 leaves: 65,535 minus 20 bytes of IP header and 8 of UDP header."""
MTU_DATAGRAM = 1472
"""What an Ethernet frame of 1500 bytes leaves: no IP fragmentation."""
IP_FRAGMENT = 1480
"""What each further Ethernet frame of an IP-fragmented datagram carries."""
LOOPBACK_PART = 65280
"""Measured to be the fastest on one host; where part and header come to a multiple of 4096,
a gathering send is up to 1.9 times slower."""

PRESETS = ("mtu", "loopback")
DatagramSize = Union[str, int]
"""A preset's name, or the bytes of the largest datagram, header included."""


class TooLarge(BadMessage):
    """A message that fits into its parts at no datagram size."""


class Split(NamedTuple):
    """How a body is cut."""

    part_size: int
    """Body bytes of every part but the last."""
    parts_max: int


def check_datagram_size(datagram_size: DatagramSize) -> DatagramSize:
    """Return `datagram_size` if it is one.

    Raises
    ------
    BadMessage
        When it is neither a preset nor in 256..65507.
    """
    if isinstance(datagram_size, str):
        valid = datagram_size in PRESETS
    else:
        valid = SMALLEST_DATAGRAM <= datagram_size <= LARGEST_DATAGRAM
    if not valid:
        raise BadMessage(
            f"datagram size {datagram_size!r} is neither mtu, loopback nor"
            f" {SMALLEST_DATAGRAM}..{LARGEST_DATAGRAM} bytes"
        )
    return datagram_size


def split(
    body_size: int,
    header_size: int,
    datagram_size: DatagramSize,
    *,
    signed_peer: bool = False,
    coded: bool = False,
) -> Split:
    """Return how a body of `body_size` bytes is cut.

    Parameters
    ----------
    coded
        Make parts that an erasure code takes as symbols: whole units, with room in a datagram
        for what stands before a repair symbol.

    Raises
    ------
    TooLarge
        When it fits at no size; the text has the sizes.
    """
    most_parts = SIGNED_PARTS_MAX if signed_peer else PARTS_MAX
    part_sizes = [_part_size(check_datagram_size(datagram_size), header_size)]
    if not coded and 0 < body_size <= part_sizes[0]:
        return Split(part_sizes[0], 1)
    grown = range(MTU_DATAGRAM, LARGEST_DATAGRAM, IP_FRAGMENT)
    part_sizes += [datagram - header_size for datagram in (*grown, LARGEST_DATAGRAM)]
    if coded:
        most = LARGEST_DATAGRAM - header_size - SYMBOL_PREFIX
        shorter = 0 if datagram_size == "loopback" else SYMBOL_PREFIX
        coded_sizes = [min(part_sizes[0] - shorter, most)]
        coded_sizes += [part_size - SYMBOL_PREFIX for part_size in part_sizes[1:]]
        part_sizes = [max(1, size // SYMBOL_UNIT) * SYMBOL_UNIT for size in coded_sizes]
    for part_size in part_sizes:
        parts = max(1, -(-body_size // max(1, part_size)))
        if part_size > 0 and parts <= most_parts:
            return Split(part_size, parts)
    raise TooLarge(
        f"a body of {body_size} bytes does not fit: {most_parts} parts of"
        f" {part_sizes[-1]} bytes hold {most_parts * part_sizes[-1]}"
    )


def plan(
    message: Message,
    datagram_size: DatagramSize = "loopback",
    *,
    signed_peer: bool = False,
    coded: bool = False,
    reserve: int = 0,
) -> Split:
    """Return how a message would be cut, or raise what `fragments` would raise.

    Of each datagram `reserve` bytes are left to what is put around it. A Control message has one
    part, whatever the datagram size.
    """
    header_size = len(message.header().pack(signed_peer=signed_peer)) + reserve
    body_size = flat(message.body).nbytes
    try:
        if message.msg_type == CONTROL:
            return _single_part(body_size, header_size)
        return split(body_size, header_size, datagram_size, signed_peer=signed_peer, coded=coded)
    except TooLarge as error:
        where = f"{type_label(message.msg_type)} on topic {message.topic!r}"
        raise TooLarge(f"{where}: {error}") from None


def fragments(
    message: Message, datagram_size: DatagramSize = "loopback", *, signed_peer: bool = False
) -> Iterator[Tuple[bytes, memoryview]]:
    """Return an iterator over the datagrams of a message: header bytes, slice of the body.

    All checks are made before the first datagram, so that nothing is sent of a bad message.

    Raises
    ------
    BadMessage
        When a field of the header is out of range or `datagram_size` is no size.
    TooLarge
        When the message fits at no datagram size.
    """
    cut = plan(message, datagram_size, signed_peer=signed_peer)
    packed = message.header(parts_max=cut.parts_max).pack(signed_peer=signed_peer)
    return Parts(packed, flat(message.body), cut)


def datagram_of(
    packed: bytes, body: memoryview, cut: Split, number: int
) -> Tuple[bytes, memoryview]:
    """Return one part of a message, header and slice; `packed` is the header of part 0."""
    header = packed[:PART_NUMBER_OFFSET] + bytes((number,)) + packed[PART_NUMBER_OFFSET + 1 :]
    start = number * cut.part_size
    return header, body[start : start + cut.part_size]


def flat(body: object) -> memoryview:
    """Return any contiguous bytes-like object as a one-dimensional view of its bytes.

    Raises
    ------
    BadMessage
        When `body` is not bytes-like or not contiguous.
    """
    try:
        view = memoryview(body)  # type: ignore[arg-type]
        # A view with a zero in its shape can't be cast, but an empty one needs no memory.
        return view.cast("B") if view.nbytes else memoryview(b"")
    except TypeError as error:
        raise BadMessage(f"the body is no contiguous bytes-like object: {error}") from None


def _single_part(body_size: int, header_size: int) -> Split:
    part_size = LARGEST_DATAGRAM - header_size
    if body_size > part_size:
        raise TooLarge(f"a body of {body_size} bytes does not fit: one part holds {part_size}")
    return Split(part_size, 1)


def _part_size(datagram_size: DatagramSize, header_size: int) -> int:
    if datagram_size == "loopback":
        return min(LOOPBACK_PART, LARGEST_DATAGRAM - header_size)
    if datagram_size == "mtu":
        return MTU_DATAGRAM - header_size
    return int(datagram_size) - header_size


class Parts:
    """The parts of a message one after the other, header and slice.

    Parameters
    ----------
    packed
        The header of part 0.
    """

    def __init__(self, packed: bytes, body: memoryview, cut: Split) -> None:
        self.packed = packed
        self.body = body
        self.cut = cut
        self.upcoming = 0
        """Number of the next part; may be set, to leave some out."""

    @property
    def parts_left(self) -> int:
        """How many are yet to come."""
        return self.cut.parts_max - self.upcoming

    def datagram_size(self, number: int) -> int:
        """Return the bytes of a part with its header."""
        left = self.body.nbytes - number * self.cut.part_size
        return len(self.packed) + min(self.cut.part_size, left)

    def __iter__(self) -> Parts:
        return self

    def __next__(self) -> Tuple[bytes, memoryview]:
        if not self.parts_left:
            raise StopIteration
        self.upcoming += 1
        return datagram_of(self.packed, self.body, self.cut, self.upcoming - 1)
