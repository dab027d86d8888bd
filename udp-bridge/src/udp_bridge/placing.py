# SPDX-License-Identifier: Apache-2.0
"""Where the next datagrams probably belong, so that they are received into their places.

A guess costs nothing but a copy when it is wrong: a datagram that landed elsewhere is gathered
and taken like any other. Only parts whose whole header, sender and size are those of an open
message count as placed. No socket here, and no rule of receiving: those are in `reassembly`.
"""

from __future__ import annotations

from typing import List, NamedTuple, Optional, Protocol, Tuple

from .assembly import Assembly
from .header import PART_NUMBER_OFFSET, Header
from .pool import Pool
from .sending import Address

MOST_AT_ONCE = 64
"""Datagrams of a run at most."""
_PARTS_MAX_OFFSET = 7


class Slots(NamedTuple):
    """Where each of the next datagrams is to be put: header apart, body in its place."""

    block: bytearray
    header_size: int
    part_size: int
    parts_max: int
    first: int
    """Part number of the first slot; the next ones follow."""
    slot_count: int


class Run(Protocol):
    """Datagrams that were received into slots, in the order in which they came."""

    slots: Slots
    count: int

    def size(self, index: int) -> int:
        """Return the bytes of a datagram."""

    def head(self, index: int) -> bytes:
        """Return as much of a datagram as the slot's header takes."""

    def sender(self, index: int) -> Address:
        """Return where a datagram came from."""

    def follows(self, index: int, heads: bytes, sizes: List[int]) -> bool:
        """Tell whether those from `index` on have these headers and sizes, and one sender.

        The sender of the one before them, if there is one, is the same.
        """

    def copy(self, index: int) -> bytes:
        """Return a whole datagram, put together."""


class Guess:
    """Follows the message that parts are coming of; guesses that the next one is like it."""

    def __init__(self, pool: Pool, share_bytes: int) -> None:
        self._pool = pool
        self._share_bytes = share_bytes
        self.header: Optional[Header] = None
        """Of part 0 of the message that is followed."""
        self.sender: Optional[Address] = None
        self.assembly: Optional[Assembly] = None
        self._head = b""
        self._shape = (0, 0, 0)
        self._next = 0

    def slots(self) -> Optional[Slots]:
        """Return where to put what comes next; None while no message of several parts came."""
        header_size, part_size, parts_max = self._shape
        if not part_size:
            return None
        most = self._share_bytes // (header_size + part_size)
        most = min(max(2, most), MOST_AT_ONCE)
        assembly = self.assembly
        if assembly is not None and not assembly.complete and assembly.block is not None:
            first, count = assembly.gap(self._next, most)
            return Slots(assembly.block, header_size, part_size, parts_max, first, count)
        self.assembly = None
        block = self._pool.offer(part_size * parts_max)
        return Slots(block, header_size, part_size, parts_max, 0, min(most, parts_max))

    def follow(
        self, header: Header, head: bytes, sender: Address, assembly: Optional[Assembly]
    ) -> None:
        """Take note of a datagram of several parts that was taken, and of its open message."""
        if assembly is None or not assembly.part_size:
            return
        self.header, self._head, self.sender, self.assembly = header, head, sender, assembly
        self._shape = (len(head), assembly.part_size, header.parts_max)
        self._next = header.part_number + 1

    def went_on(self, number: int) -> None:
        """Take note that parts before `number` came."""
        self._next = number

    def are_placed(self, run: Run, index: int) -> bool:
        """Tell at once of all from `index` on what `is_placed` tells of one."""
        assembly, slots = self.assembly, run.slots
        return (
            assembly is not None
            and assembly.block is slots.block
            and not assembly.complete
            and assembly.lacks(slots.first + index, run.count - index)
            and self._shape == (slots.header_size, slots.part_size, slots.parts_max)
            and self._is_like(run, index, self._head)
            and run.sender(index) == self.sender
        )

    def _is_like(self, run: Run, index: int, head: bytes) -> bool:
        slots = run.slots
        first, end = slots.first + index, slots.first + run.count
        heads = bytearray(head * (end - first))
        heads[PART_NUMBER_OFFSET :: len(head)] = bytes(range(first, end))
        sizes = [slots.header_size + slots.part_size] * (end - first)
        if end == head[_PARTS_MAX_OFFSET]:
            sizes[-1] = run.size(run.count - 1)
            if not slots.header_size < sizes[-1] <= slots.header_size + slots.part_size:
                return False
        return run.follows(index, bytes(heads), sizes)

    def all_begin(self, run: Run) -> bool:
        """Tell whether all of a run lie in their places as parts of one new message."""
        return self.assembly is None and self.begins(run, 0) and self._is_like(run, 0, run.head(0))

    def is_placed(self, run: Run, index: int) -> bool:
        """Tell whether a datagram is the part of the followed message that its slot is for."""
        assembly, slots = self.assembly, run.slots
        number = slots.first + index
        if assembly is None or assembly.block is not slots.block or assembly.complete:
            return False
        head = run.head(index)
        body = run.size(index) - slots.header_size
        is_last = number == slots.parts_max - 1
        return (
            (body == slots.part_size or (is_last and 0 < body < slots.part_size))
            and head[PART_NUMBER_OFFSET] == number
            and head[:PART_NUMBER_OFFSET] == self._head[:PART_NUMBER_OFFSET]
            and head[_PARTS_MAX_OFFSET:] == self._head[_PARTS_MAX_OFFSET:]
            and not assembly.has(number)
            and run.sender(index) == self.sender
        )

    def begins(self, run: Run, index: int) -> bool:
        """Tell whether a datagram may begin a message in the block that its slot is in."""
        slots = run.slots
        head = run.head(index)
        number = slots.first + index
        return (
            self.assembly is None
            and run.size(index) == slots.header_size + slots.part_size
            and head[1] == slots.header_size
            and head[PART_NUMBER_OFFSET] == number
            and number + 1 < head[_PARTS_MAX_OFFSET] <= slots.parts_max
        )


def strays(guess: Guess, run: Run) -> List[Optional[bytes]]:
    """Return a copy of each datagram of a run that does not surely lie in its place.

    They are copied before anything else is done, because to place one may overwrite another.
    """
    if guess.are_placed(run, 0) or guess.all_begin(run):
        return [None] * run.count
    if guess.assembly is not None:
        return [
            None if guess.is_placed(run, index) else run.copy(index) for index in range(run.count)
        ]
    begun: Optional[Tuple[bytes, bytes, Address]] = None
    copies: List[Optional[bytes]] = []
    for index in range(run.count):
        head = run.head(index)
        likeness = (head[:PART_NUMBER_OFFSET], head[_PARTS_MAX_OFFSET:], run.sender(index))
        is_whole = len(head) < run.size(index)
        if is_whole and likeness == begun and head[PART_NUMBER_OFFSET] == run.slots.first + index:
            copies.append(None)
        elif begun is None and guess.begins(run, index):
            begun = likeness
            copies.append(None)
        else:
            copies.append(run.copy(index))
    return copies


def place_of(run: Run, index: int) -> memoryview:
    """Return the part that a datagram of a run left in its slot."""
    slots = run.slots
    start = (slots.first + index) * slots.part_size
    return memoryview(slots.block)[start : start + run.size(index) - slots.header_size]
