# SPDX-License-Identifier: Apache-2.0
"""Receive slots: where the next parts of a message will lie, so that they are received in place.

The predictor assumes that the message in progress continues, and that the next message looks like
the last one. A datagram matches only if its whole header, sender and size are as predicted. Any
other datagram is returned unmatched and takes the ordinary path, which costs one copy.
"""

from __future__ import annotations

from struct import Struct
from typing import NamedTuple, Optional, Tuple, Union

from udp_bridge.wire.header import (
    NANOS,
    PART_NUMBER_OFFSET,
    PARTS_MAX_OFFSET,
    TIME_END,
    TIME_OFFSET,
    Header,
)
from udp_bridge.wire.message import Address, TopicKey

from .assembly import Assembly
from .nack import NackTracker
from .pool import BlockPool
from .small_topics import TopicOrigin, TopicRow

_MESSAGE_FIELDS = Struct("<2xI2xii")
"""Header fields that differ between messages of a topic: seq_number, time_sec, time_nsec."""


class ReceiveSlots(NamedTuple):
    """Predicted parts of one message and the block that they are received into."""

    block: bytearray
    header: bytes
    """Packed header of a part of this message, or of the previous one; ignore its part number."""
    sender: Address
    part_size: int
    next_part: int
    """The part that is expected next."""
    arrived: Union[bytes, bytearray]
    """One byte per part, 1 where it has arrived; empty when nothing is predicted."""
    is_open: bool
    """Whether a part of the message has arrived. If not, seq_number and time are unknown."""
    nack_due_nanos: int
    """Monotonic time at which missing parts are to be requested; 0 for never. A batch ends then."""
    debounce_nanos: int
    """Time from the detection of a gap to its request; 0 where parts can't be requested."""
    may_nack: bool = False
    """Whether the socket itself may send one request for the gaps of this message."""
    row: Optional[TopicRow] = None
    """The topic of the message, if a socket may return the next one as such; see `WholeMessage`."""

    def matches(self, header: bytes, size: int, sender: Address) -> bool:
        """Tell whether a datagram of `size` bytes with this header is a missing part.

        A message must begin with its first part.
        """
        body_size = size - len(self.header)
        if not self.arrived or not 0 < body_size <= self.part_size:
            return False
        number = header[PART_NUMBER_OFFSET]
        return (
            (body_size == self.part_size or number + 1 == header[PARTS_MAX_OFFSET])
            and number < len(self.arrived)
            and not self.arrived[number]
            and (self.is_open or number == self.next_part)
            and header[PARTS_MAX_OFFSET] == self.header[PARTS_MAX_OFFSET]
            and header[:2] == self.header[:2]
            and header[TIME_END:] == self.header[TIME_END:]
            and sender == self.sender
            and (
                header[2:PART_NUMBER_OFFSET] == self.header[2:PART_NUMBER_OFFSET]
                and header[TIME_OFFSET:TIME_END] == self.header[TIME_OFFSET:TIME_END]
                if self.is_open
                else 0 <= _MESSAGE_FIELDS.unpack_from(header)[2] < NANOS
            )
        )


NO_SLOTS = ReceiveSlots(bytearray(), b"", ("0.0.0.0", 0), 0, 0, b"", False, 0, 0)
"""Nothing is predicted; every datagram is unmatched."""


class CreditState(NamedTuple):
    """What the socket needs to acknowledge parts while it receives them."""

    uncredited_bytes: int
    receive_buffer: int
    seq_number: int
    """seq_number of the next Credit."""
    goodput: int = 0
    """Bytes per second; part of a Request."""


class PartBatch(NamedTuple):
    """Parts that were received into their slots, and the datagram that ended the batch."""

    header: bytes
    """Packed header of the part that arrived first."""
    part_ranges: Tuple[Tuple[int, int], ...]
    """Parts in order of arrival, as (first part, number of parts)."""
    last_part_size: int
    """Body bytes of the message's last part, if it arrived; the others have the part size."""
    credits_sent: int
    uncredited_bytes: int
    """Bytes of parts since the last Credit."""
    unmatched: Optional[bytes]
    """A whole datagram that is not a predicted part; it arrived last."""
    unmatched_sender: Optional[Address]
    refused: str = ""
    """Why the datagram that arrived last was refused."""
    mailbox_credits: int = 0
    """Credits that were put into the sender's mailbox; see `credit_mailbox`."""
    mailbox_bytes: int = 0
    is_delegation_done: bool = False
    """Whether the socket finished or gave up the message that was delegated to it."""
    nack_bitmap: bytes = b""
    """Parts that the socket requested; empty when it sent no request."""
    nack_nanos: int = 0
    """Monotonic time of that request."""

    @property
    def parts_count(self) -> int:
        """Number of parts that arrived."""
        if len(self.part_ranges) == 1:
            return self.part_ranges[0][1]
        return sum(count for _, count in self.part_ranges)


class SlotPredictor:
    """Follows the message in progress and predicts that the next one looks like it."""

    def __init__(self, pool: BlockPool) -> None:
        self._pool = pool
        self._header: Optional[Header] = None  # of the part that arrived last
        self._packed_header = b""
        self._sender = NO_SLOTS.sender
        self._source = TopicOrigin(self._sender, (0, ""), "")
        self._part_size = self._parts_max = 0
        self._nacks: Optional[NackTracker] = None
        self._assembly: Optional[Assembly] = None  # of that message, while it is open
        self._next_part = 0

    @property
    def topic_key(self) -> TopicKey:
        """Type and topic of the message that is followed."""
        header = self._header
        return (header.msg_type, header.topic) if header is not None else (0, "")

    def predict(self, row: Optional[TopicRow] = None) -> ReceiveSlots:
        """Return the slots of the parts that are expected next.

        Parameters
        ----------
        row
            The topic, if its next message may be delivered when it arrives whole.
        """
        assembly = self._open_assembly()
        if assembly is not None:
            number, arrived = assembly.next_missing(self._next_part), assembly.arrived
            block, is_open = assembly.block, True
            assert block is not None
        elif self._parts_max:
            number, arrived, is_open = 0, bytearray(self._parts_max), False
            self._assembly = None
            block = self._pool.offer(self._part_size * self._parts_max)
        else:
            return NO_SLOTS
        due_nanos, debounce_nanos, may_nack = 0, 0, False
        nacks = self._nacks
        if nacks is not None:
            due_nanos, debounce_nanos = nacks.due_nanos, nacks.debounce_nanos
            may_nack = not due_nanos and not (
                is_open and self._header is not None and nacks.is_requested(self._header)
            )
        return ReceiveSlots(
            block,
            self._packed_header,
            self._sender,
            self._part_size,
            number,
            arrived,
            is_open,
            due_nanos,
            debounce_nanos,
            may_nack,
            row,
        )

    @property
    def next_source(self) -> Optional[TopicOrigin]:
        """Origin of the message that is predicted; None while one is open or none is known."""
        return self._source if self._parts_max and self._open_assembly() is None else None

    @property
    def next_bytes(self) -> int:
        """Most bytes of the body of the message that is predicted."""
        return self._part_size * self._parts_max

    def _open_assembly(self) -> Optional[Assembly]:
        assembly = self._assembly
        is_open = assembly is not None and not assembly.is_complete and assembly.block is not None
        return assembly if is_open else None

    def follow(
        self,
        header: Header,
        packed_header: bytes,
        sender: Address,
        assembly: Optional[Assembly],
        nacks: Optional[NackTracker],
    ) -> None:
        """Follow the open message of a part that arrived outside a batch."""
        if assembly is None or not assembly.part_size:
            return
        self._advance(header.part_number + 1, assembly)
        self._header, self._packed_header, self._sender = header, packed_header, sender
        self._source = TopicOrigin(sender, (header.msg_type, header.topic), header.link)
        self._part_size, self._parts_max = assembly.part_size, header.parts_max
        self._nacks = nacks

    def on_complete(self, packed_header: bytes) -> None:
        """Update the prediction after a message became complete, of which this is a header."""
        self._next_part, self._assembly, self._packed_header = 0, None, packed_header

    def on_incomplete(
        self, batch: PartBatch, assembly: Optional[Assembly], nacks: Optional[NackTracker]
    ) -> None:
        """Update the prediction after a batch that left its message incomplete.

        `assembly` is None if that message is no longer open.
        """
        self._nacks = nacks
        # If the batch contradicted an open message, it was refused; don't follow that message.
        end = max(first + count for first, count in batch.part_ranges)
        self._advance(end, assembly if assembly is not None and self._fits(assembly) else None)
        self._packed_header = batch.header

    def _advance(self, number: int, assembly: Optional[Assembly]) -> None:
        """Expect part `number` next; a repeated part does not set the prediction back."""
        is_same = assembly is not None and assembly is self._assembly
        self._next_part = max(self._next_part, number) if is_same else number
        self._assembly = assembly

    def _fits(self, assembly: Assembly) -> bool:
        assert self._header is not None
        return (
            assembly.part_size == self._part_size
            and assembly.header.parts_max == self._parts_max
            and assembly.header.link == self._header.link
        )

    def header_of(self, batch: PartBatch) -> Header:
        """Return the parsed header of the part of a batch that arrived first."""
        last = self._header
        assert last is not None
        number, sec, nsec = _MESSAGE_FIELDS.unpack_from(batch.header)
        first_part = batch.part_ranges[0][0]
        self._header = Header(
            last.msg_type, number, first_part, last.parts_max, sec, nsec, last.topic, last.link
        )
        return self._header
