# SPDX-License-Identifier: Apache-2.0
"""Assembly of one message: its parts and repair symbols, until its body is complete.

The first copy of a part counts, and the first part that is not the last one fixes the part size.
The body lies in a block of the pool that is as large as the message announces; a part that was
received into this very block is not copied. Other messages, order and limits are not known here.
"""

from __future__ import annotations

from typing import Dict, NamedTuple, Optional

from udp_bridge.wire import fec
from udp_bridge.wire.header import Buffer, Header, Refused
from udp_bridge.wire.repair import Symbol

from .pool import BlockPool, block_bytes

OVERHEAD_BYTES = 1536
"""Memory of an open message besides its body: the objects here and in `limits`."""
RECOVERY_ATTEMPTS = 8
"""Attempts to decode one message. With as many symbols as parts, one in 256 attempts fails; each
further symbol makes failures 256 times rarer."""


class AddedPart(NamedTuple):
    """Result of adding a part that was not refused."""

    is_duplicate: bool = False
    refused: str = ""
    """Why the last part, which arrived before this one, was refused now."""


class RepairSymbols:
    """Repair symbols of one message, at most as many as it has parts."""

    __slots__ = ("attempts", "body_size", "by_number", "symbol_size")

    def __init__(self, body_size: int, symbol_size: int) -> None:
        self.body_size = body_size
        self.symbol_size = symbol_size
        self.by_number: Dict[int, bytes] = {}
        """Symbols by their index among those that were sent."""
        self.attempts = 0


class Assembly:
    """Parts and repair symbols of one message of several parts."""

    __slots__ = (
        "_body_bytes",
        "_early_last_part",
        "_part_size",
        "_pool",
        "_size",
        "_symbols",
        "_view",
        "arrived",
        "block",
        "header",
        "parts_in",
        "since_nanos",
    )

    def __init__(self, header: Header, since_nanos: int, pool: BlockPool) -> None:
        self.header = header
        self.since_nanos = since_nanos
        """When the first part arrived."""
        self.parts_in = 0
        self.arrived = bytearray(header.parts_max)
        """One byte per part: 1 if it has arrived, else 0."""
        self.block: Optional[bytearray] = None
        """Where the parts lie, once their size is known."""
        self._pool = pool
        self._view = memoryview(b"")  # of the block, which stays in use as long as this exists
        self._size = 0  # of the whole body; known once the last part has arrived
        self._part_size: Optional[int] = None
        self._body_bytes = 0  # size of the block, once the part size is known
        self._early_last_part: Optional[bytes] = None  # arrived before the part size was known
        self._symbols: Optional[RepairSymbols] = None

    @property
    def is_complete(self) -> bool:
        """Whether all parts have arrived."""
        return self.parts_in == self.header.parts_max

    @property
    def held_bytes(self) -> int:
        """Memory of the message; its whole block once the part size is known."""
        body = self._body_bytes or len(self._early_last_part or b"")
        symbols = self._symbols
        if symbols is not None:
            body += len(symbols.by_number) * symbols.symbol_size
        return OVERHEAD_BYTES + body

    @property
    def body(self) -> memoryview:
        """The whole body, read-only; valid once `is_complete`."""
        return self._view[: self._size].toreadonly()

    @property
    def part_size(self) -> int:
        """Body bytes of every part but the last; 0 until it is known."""
        return self._part_size or 0

    @property
    def has_symbols(self) -> bool:
        """Whether a repair symbol has arrived."""
        return self._symbols is not None

    def next_missing(self, first: int) -> int:
        """Return the first missing part from `first` on, or else from 0 on."""
        number = self.arrived.find(0, first)
        return number if number >= 0 else self.arrived.find(0)

    def check(self, header: Header, size: int) -> None:
        """Raise `Refused` if a part of `size` bytes contradicts earlier parts."""
        if header.parts_max != self.header.parts_max:
            raise Refused("parts_max")
        if header.link != self.header.link:
            raise Refused("link")
        if not self.arrived[header.part_number] and self._part_size is not None:
            self._check_size(size, header.part_number == header.parts_max - 1)

    def add(self, header: Header, part: Buffer) -> AddedPart:
        """Add one part.

        Raises
        ------
        Refused
            If the part contradicts earlier parts.
        """
        if header.parts_max != self.header.parts_max:
            raise Refused("parts_max")
        if header.link != self.header.link:
            raise Refused("link")
        number = header.part_number
        if self.arrived[number]:
            return AddedPart(is_duplicate=True)
        is_last = number == header.parts_max - 1
        refused = ""
        if self._part_size is None and is_last:
            self._early_last_part = bytes(part)
        else:
            if self._part_size is None:
                self._fix_part_size(len(part))
                refused = self._place_early_last_part()
            self._check_size(len(part), is_last)
            self._place(number, part)
        self.arrived[number] = 1
        self.parts_in += 1
        return AddedPart(refused=refused)

    def adopt_block(self, block: bytearray, part_size: int) -> bool:
        """Take the block that the pool offered, if it is `block`; return whether it is."""
        if self._pool.take_offered(block, part_size * self.header.parts_max) is None:
            return False
        self.block, self._view = block, memoryview(block)
        self._fix_part_size(part_size)
        return True

    def mark_received(self, first: int, count: int, last_part_size: int) -> None:
        """Record missing parts that lie in the block already; the caller has checked them."""
        assert self._part_size is not None
        end = first + count
        self.arrived[first:end] = b"\1" * count
        self.parts_in += count
        if end == self.header.parts_max:
            self._size = (end - 1) * self._part_size + last_part_size

    def check_symbol(self, symbol: Symbol, data: Buffer) -> None:
        """Raise `Refused` if a repair symbol contradicts earlier parts or symbols."""
        if symbol.parts_max != self.header.parts_max:
            raise Refused("parts_max")
        known = self._symbols
        if known is None:
            self._expect_part_size(len(data))
        elif known.body_size != symbol.body_size or known.symbol_size != len(data):
            raise Refused("part_size")

    def add_symbol(self, number: int, symbol: Symbol, data: Buffer) -> bool:
        """Keep a symbol that passed `check_symbol`; return whether it is new."""
        known = self._symbols
        if known is None:
            self._expect_part_size(len(data))
            known = self._symbols = RepairSymbols(symbol.body_size, len(data))
        if number in known.by_number:
            return False
        if len(known.by_number) < symbol.parts_max:
            known.by_number[number] = bytes(data)
        return True

    def recover(self) -> bool:
        """Recover the missing parts if there are enough symbols; return whether it is complete."""
        symbols, parts_max = self._symbols, self.header.parts_max
        if symbols is None or symbols.attempts >= RECOVERY_ATTEMPTS:
            return False
        if self.parts_in + len(symbols.by_number) < parts_max:
            return False
        size = symbols.symbol_size
        known: Dict[int, Buffer] = {}
        missing = []
        for number in range(parts_max):
            if self.arrived[number]:
                known[number] = bytes(self._part(number)).ljust(size, b"\0")
            else:
                missing.append(number)
        known.update({parts_max + number: data for number, data in symbols.by_number.items()})
        body = fec.recover(known, parts_max, size)
        if body is None:
            symbols.attempts += 1
            return False
        view = memoryview(body)[: symbols.body_size]
        for number in missing:
            part = view[number * size : (number + 1) * size]
            self.add(self.header._replace(part_number=number), part)
        return self.is_complete

    def _part(self, number: int) -> memoryview:
        """Return the bytes of a part that has arrived, once the part size is known."""
        assert self._part_size is not None
        start = number * self._part_size
        end = self._size if number == self.header.parts_max - 1 else start + self._part_size
        return self._view[start:end]

    def _expect_part_size(self, part_size: int) -> None:
        """Take the part size from a symbol; raise `Refused` if a part contradicts it."""
        if self._part_size is not None:
            if self._part_size != part_size:
                raise Refused("part_size")
            return
        if self._early_last_part is not None and len(self._early_last_part) > part_size:
            raise Refused("part_size")
        self._fix_part_size(part_size)
        self._place_early_last_part()

    def _fix_part_size(self, part_size: int) -> None:
        self._part_size = part_size
        self._body_bytes = block_bytes(part_size * self.header.parts_max)

    def _place_early_last_part(self) -> str:
        """Place a last part that arrived before the size was known; return why it is refused."""
        part, self._early_last_part = self._early_last_part, None
        assert self._part_size is not None
        last = self.header.parts_max - 1
        if part is None:
            return ""
        if len(part) <= self._part_size:
            self._place(last, part)
            return ""
        self.arrived[last] = 0  # a valid one may still arrive
        self.parts_in -= 1
        return "part_size"

    def _check_size(self, size: int, is_last: bool) -> None:
        assert self._part_size is not None
        if size > self._part_size or (size < self._part_size and not is_last):
            raise Refused("part_size")

    def _place(self, number: int, part: Buffer) -> None:
        assert self._part_size is not None
        start = number * self._part_size
        end = start + len(part)
        owner = part.obj if isinstance(part, memoryview) else None
        if self.block is None:
            size = self._part_size * self.header.parts_max
            self.block = self._pool.take_offered(owner, size) or self._pool.lease(size)
            self._view = memoryview(self.block)
        if owner is not self.block:
            self._view[start:end] = part
        if number == self.header.parts_max - 1:
            self._size = end
