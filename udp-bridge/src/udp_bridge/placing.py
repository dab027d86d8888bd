# SPDX-License-Identifier: Apache-2.0
"""Where the next parts probably belong, so that they are received into their places.

A guess costs nothing but a copy when it is wrong. Only a datagram whose whole header, sender and
size are those expected lies in its place; every other one is stray, and handed over whole. No
socket here, and no rule of receiving: those are in `reassembly`.
"""

from __future__ import annotations

from struct import Struct
from typing import NamedTuple, Optional

from .assembly import Assembly
from .header import NANOS, PART_NUMBER_OFFSET, Header
from .pool import Pool
from .resend_asking import Asking
from .sending import Address

_PARTS_MAX_OFFSET = 7
_TIME_OFFSET = 8
_TIME_END = 16
_OWN = Struct("<2xI2xii")
"""What a message has for itself in the header: seq_number, time_sec, time_nsec."""


class Place(NamedTuple):
    """What is expected next, and where it is to be put."""

    block: bytearray
    head: bytes
    """Header of a part of the message, or of the one before it; the part number means nothing."""
    sender: Address
    part_size: int
    first: int
    """The part that is expected next."""
    parts_count: int
    """Parts from there on that are missing in a row; 0 when nothing is expected."""
    is_open: bool
    """A part of the message was taken. Else seq_number and time are not known yet."""
    due_nanos: int
    """When something missing is to be asked for, by the monotonic clock, so that more may not be
    waited for behind parts that came; 0 when nothing is."""

    def takes(self, head: bytes, size: int, sender: Address) -> bool:
        """Tell whether a datagram of `size` bytes that begins so is the part expected next."""
        body_size = size - len(self.head)
        return (
            self.parts_count > 0
            and (
                body_size == self.part_size
                or (0 < body_size < self.part_size and self.first + 1 == head[_PARTS_MAX_OFFSET])
            )
            and head[PART_NUMBER_OFFSET] == self.first
            and head[_PARTS_MAX_OFFSET] == self.head[_PARTS_MAX_OFFSET]
            and head[:2] == self.head[:2]
            and head[_TIME_END:] == self.head[_TIME_END:]
            and sender == self.sender
            and (
                head[2:PART_NUMBER_OFFSET] == self.head[2:PART_NUMBER_OFFSET]
                and head[_TIME_OFFSET:_TIME_END] == self.head[_TIME_OFFSET:_TIME_END]
                if self.is_open
                else 0 <= _OWN.unpack_from(head)[2] < NANOS
            )
        )


NOWHERE = Place(bytearray(), b"", ("0.0.0.0", 0), 0, 0, 0, False, 0)
"""Nothing is expected; whatever comes is stray."""


class Credits(NamedTuple):
    """What is needed to acknowledge parts as they come."""

    uncredited_bytes: int
    receive_buffer: int
    number: int
    """seq_number of the next credit."""


class Run(NamedTuple):
    """Parts that lie in their places one behind the other, and what came behind them."""

    head: bytes
    """Header of the first part."""
    parts_count: int
    last_size: int
    """Body bytes of the last part; the others have the part size."""
    credits: int
    """Credits that were sent."""
    uncredited_bytes: int
    """Bytes of parts since the last one."""
    stray: Optional[bytes]
    """A whole datagram that is no such part; it came last."""
    sender: Optional[Address]
    """Where the stray one came from."""
    refused: str = ""
    """Why another one that came last must not be taken."""
    parked: int = 0
    """Credits that were kept for the sender, and their bytes; see `parking`."""
    parked_bytes: int = 0
    order_is_over: bool = False
    """What was left to be sent here was sent, or can't be; see `parking`."""


class Guess:
    """Follows the message that parts are coming of; guesses that the next one is like it."""

    def __init__(self, pool: Pool) -> None:
        self._pool = pool
        self._header: Optional[Header] = None  # of a part of the message that came last
        self._head = b""  # the same, packed
        self._sender = NOWHERE.sender
        self._part_size = self._parts_max = 0
        self._asking: Optional[Asking] = None
        self._assembly: Optional[Assembly] = None  # that message, while it is open
        self._next = 0

    @property
    def topic(self) -> str:
        """Of the message that is followed."""
        return self._header.topic if self._header is not None else ""

    def place(self) -> Place:
        """Return what is expected next."""
        assembly = self._assembly
        if assembly is not None and not assembly.complete and assembly.block is not None:
            first, count = assembly.gap(self._next)
            block, is_open = assembly.block, True
        elif self._parts_max:
            first, count, is_open = 0, self._parts_max, False
            self._assembly = None
            block = self._pool.offer(self._part_size * count)
        else:
            return NOWHERE
        due_nanos = self._asking.due_nanos if self._asking is not None else 0
        return Place(
            block,
            self._head,
            self._sender,
            self._part_size,
            first,
            count,
            is_open,
            due_nanos,
        )

    def follow(
        self,
        header: Header,
        head: bytes,
        sender: Address,
        assembly: Optional[Assembly],
        asking: Optional[Asking],
    ) -> None:
        """Take note of a datagram of several parts that was taken, and of its open message."""
        if assembly is None or not assembly.part_size:
            return
        self._advance(header.part_number + 1, assembly)
        self._header, self._head, self._sender = header, head, sender
        self._part_size, self._parts_max = assembly.part_size, header.parts_max
        self._asking = asking

    def went_on(self, run: Run, number: int, assembly: Optional[Assembly]) -> None:
        """Take note that a run came, and of its message if it is still open."""
        # A message that the run contradicts, so that it was refused, must not be followed.
        self._advance(number, assembly if assembly is not None and self._fits(assembly) else None)
        self._head = run.head

    def _advance(self, number: int, assembly: Optional[Assembly]) -> None:
        """Expect that part next; behind one sent again, the message goes on where it was."""
        is_same = assembly is not None and assembly is self._assembly
        self._next = max(self._next, number) if is_same else number
        self._assembly = assembly

    def _fits(self, assembly: Assembly) -> bool:
        assert self._header is not None
        return (
            assembly.part_size == self._part_size
            and assembly.header.parts_max == self._parts_max
            and assembly.header.link == self._header.link
        )

    def header_of(self, place: Place, run: Run) -> Header:
        """Return the header of the first part of a run that came to a place."""
        like = self._header
        assert like is not None
        number, sec, nsec = _OWN.unpack_from(run.head)
        self._header = Header(
            like.msg_type, number, place.first, like.parts_max, sec, nsec, like.topic, like.link
        )
        return self._header
