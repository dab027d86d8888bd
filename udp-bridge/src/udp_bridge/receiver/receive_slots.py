# SPDX-License-Identifier: Apache-2.0
"""Where the next parts probably belong, so that they are received into their places.

A guess costs nothing but a copy when it is wrong. Only a datagram whose whole header, sender and
size are those expected lies in its place; every other one is stray, and handed over whole. No
socket here, and no rule of receiving: those are in `reassembly`.
"""

from __future__ import annotations

from struct import Struct
from typing import NamedTuple, Optional, Tuple, Union

from udp_bridge.wire.header import NANOS, PART_NUMBER_OFFSET, Header
from udp_bridge.wire.message import Address

from .assembly import Assembly
from .nack import Asking
from .pool import Pool

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
    next: int
    """The part that is expected next."""
    arrived: Union[bytes, bytearray]
    """One byte for each part, 1 where it is in; empty when nothing is expected."""
    is_open: bool
    """A part of the message was taken. Else seq_number and time are not known yet."""
    due_nanos: int
    """When something missing is to be asked for, by the monotonic clock, so that more may not be
    waited for behind parts that came; 0 when nothing is."""
    patience_nanos: int
    """So long behind a part that leaves a gap that is to be asked for; 0 when it can't be."""
    may_ask: bool = False
    """Nothing of the message was asked for, and nothing else is due: whoever receives may ask for
    its gaps when that is due, once."""

    def takes(self, head: bytes, size: int, sender: Address) -> bool:
        """Tell whether a datagram of `size` bytes that begins so is a part that is missing.

        Of a message of which nothing came, the first part has to come first.
        """
        body_size = size - len(self.head)
        if not self.arrived or not 0 < body_size <= self.part_size:
            return False
        number = head[PART_NUMBER_OFFSET]
        return (
            (body_size == self.part_size or number + 1 == head[_PARTS_MAX_OFFSET])
            and number < len(self.arrived)
            and not self.arrived[number]
            and (self.is_open or number == self.next)
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


NOWHERE = Place(bytearray(), b"", ("0.0.0.0", 0), 0, 0, b"", False, 0, 0)
"""Nothing is expected; whatever comes is stray."""


class Credits(NamedTuple):
    """What is needed to acknowledge parts as they come."""

    uncredited_bytes: int
    receive_buffer: int
    number: int
    """seq_number of the next credit."""
    goodput: int = 0
    """What a request tells of it."""


class Run(NamedTuple):
    """Parts that lie in their places, and what came behind them."""

    head: bytes
    """Header of the part that came first."""
    rows: Tuple[Tuple[int, int], ...]
    """Parts by order of arrival: the first one of those in a row, and how many."""
    last_size: int
    """Body bytes of the message's last part, if that came; the others have the part size."""
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
    asked: bytes = b""
    """Bitmap of the parts that were asked for where they were received; empty when none was."""
    asked_nanos: int = 0
    """When that was done, by the monotonic clock."""

    @property
    def parts_count(self) -> int:
        """How many parts came."""
        if len(self.rows) == 1:
            return self.rows[0][1]
        return sum(count for _, count in self.rows)


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
            number, arrived = assembly.missing(self._next), assembly.arrived
            block, is_open = assembly.block, True
        elif self._parts_max:
            number, arrived, is_open = 0, bytearray(self._parts_max), False
            self._assembly = None
            block = self._pool.offer(self._part_size * self._parts_max)
        else:
            return NOWHERE
        due_nanos, patience_nanos, may_ask = 0, 0, False
        asking = self._asking
        if asking is not None:
            due_nanos, patience_nanos = asking.patience
            may_ask = not due_nanos and not (
                is_open and self._header is not None and asking.is_asked(self._header)
            )
        return Place(
            block,
            self._head,
            self._sender,
            self._part_size,
            number,
            arrived,
            is_open,
            due_nanos,
            patience_nanos,
            may_ask,
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

    def is_done(self, run: Run) -> None:
        """Take note that a run came which made its message whole."""
        self._next, self._assembly, self._head = 0, None, run.head

    def went_on(self, run: Run, assembly: Optional[Assembly], asking: Optional[Asking]) -> None:
        """Take note that a run came which did not, and of its message if that is still open."""
        self._asking = asking
        # A message that the run contradicts, so that it was refused, must not be followed.
        end = max(first + count for first, count in run.rows)
        self._advance(end, assembly if assembly is not None and self._fits(assembly) else None)
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

    def header_of(self, run: Run) -> Header:
        """Return the header of the part of a run that came first."""
        like = self._header
        assert like is not None
        number, sec, nsec = _OWN.unpack_from(run.head)
        self._header = Header(
            like.msg_type, number, run.rows[0][0], like.parts_max, sec, nsec, like.topic, like.link
        )
        return self._header
