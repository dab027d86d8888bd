# SPDX-License-Identifier: Apache-2.0
"""One message's parts on their way to a body. No other message, no order, no time limit.

The first copy of a part counts, and the first part that is not the last fixes the part size.
The body lies in a block of a pool, as large as the message announces; `holdings` bounds what is
held.
A part that was received into its place in this very block is not moved.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Optional

from udp_bridge.wire.header import Buffer, Header, Refused

from .pool import Pool, block_bytes

if TYPE_CHECKING:
    from .fec import Symbols


OVERHEAD_BYTES = 1536
"""What an open message takes besides bodies: its objects here and its places in `holdings`."""


class Added(NamedTuple):
    """What became of a part that was not refused itself."""

    is_duplicate: bool = False
    refused: str = ""
    """Why the last part, which had come before this one, was refused now."""


class Assembly:
    """The parts of one message of more than one part."""

    __slots__ = (
        "_arrived",
        "_aside",
        "_block",
        "_body_bytes",
        "_part_size",
        "_pool",
        "_size",
        "_view",
        "header",
        "parts_in",
        "since_nanos",
        "symbols",
    )

    def __init__(self, header: Header, since_nanos: int, pool: Optional[Pool] = None) -> None:
        self.header = header
        self.since_nanos = since_nanos
        """When its first part came."""
        self.parts_in = 0
        self._arrived = bytearray(header.parts_max)
        self._pool = pool if pool is not None else Pool()
        self._block: Optional[bytearray] = None
        self._view = memoryview(b"")  # of the block, which stays taken as long as there is one
        self._size = 0  # of the whole body; known with the last part
        self._part_size: Optional[int] = None
        self._body_bytes = 0  # that the body's block takes, once the part size is known
        self._aside: Optional[bytes] = None  # a last part that came before the size was known
        self.symbols: Optional[Symbols] = None
        """Repair symbols that came for it; `fec_parts` keeps and uses them."""

    @property
    def complete(self) -> bool:
        """Whether all parts are in."""
        return self.parts_in == self.header.parts_max

    @property
    def held_bytes(self) -> int:
        """Memory that the message takes now: its whole block as soon as the part size is known."""
        body = self._body_bytes or len(self._aside or b"")
        symbols = self.symbols.bytes_held if self.symbols is not None else 0
        return OVERHEAD_BYTES + body + symbols

    @property
    def body(self) -> memoryview:
        """The whole body, read-only; of use once `complete`."""
        return self._view[: self._size].toreadonly()

    def check(self, header: Header, size: int) -> None:
        """Raise `Refused` when a part of `size` bytes contradicts what is known of its message."""
        if header.parts_max != self.header.parts_max:
            raise Refused("parts_max")
        if header.link != self.header.link:
            raise Refused("link")
        if not self._arrived[header.part_number] and self._part_size is not None:
            self._check_size(size, header.part_number == header.parts_max - 1)

    def add(self, header: Header, part: Buffer) -> Added:
        """Take one part.

        Raises
        ------
        Refused
            When the part contradicts what is known of its message.
        """
        if header.parts_max != self.header.parts_max:
            raise Refused("parts_max")
        if header.link != self.header.link:
            raise Refused("link")
        number = header.part_number
        if self._arrived[number]:
            return Added(is_duplicate=True)
        is_last = number == header.parts_max - 1
        refused = ""
        if self._part_size is None and is_last:
            self._aside = bytes(part)
        else:
            if self._part_size is None:
                self._fix_part_size(len(part))
                refused = self._place_aside()
            self._check_size(len(part), is_last)
            self._place(number, part)
        self._arrived[number] = 1
        self.parts_in += 1
        return Added(refused=refused)

    @property
    def block(self) -> Optional[bytearray]:
        """Where the parts lie, as soon as their size is known."""
        return self._block

    @property
    def part_size(self) -> int:
        """Body bytes of every part but the last; 0 while they are not known."""
        return self._part_size or 0

    def missing(self, first: int) -> int:
        """Return the first missing part from `first` on, or else from 0 on."""
        number = self._arrived.find(0, first)
        return number if number >= 0 else self._arrived.find(0)

    @property
    def arrived(self) -> bytearray:
        """One byte for each part: 1 where it is in, else 0."""
        return self._arrived

    def adopt(self, block: bytearray, part_size: int) -> bool:
        """Take the offered block, where parts lie already; return whether `block` is it."""
        if self._pool.take_offered(block, part_size * self.header.parts_max) is None:
            return False
        self._block, self._view = block, memoryview(block)
        self._fix_part_size(part_size)
        return True

    def placed(self, first: int, count: int, last_size: int) -> None:
        """Take note of missing parts that lie in their places; the sender's word is checked."""
        assert self._part_size is not None
        end = first + count
        self._arrived[first:end] = b"\1" * count
        self.parts_in += count
        if end == self.header.parts_max:
            self._size = (end - 1) * self._part_size + last_size

    def has(self, number: int) -> bool:
        """Tell whether a part is in."""
        return bool(self._arrived[number])

    def part(self, number: int) -> memoryview:
        """Return the bytes of a part that is in, once the part size is known."""
        assert self._part_size is not None
        start = number * self._part_size
        size = self._size if number == self.header.parts_max - 1 else start + self._part_size
        return self._view[start:size]

    def expect(self, part_size: int) -> None:
        """Take the part size from elsewhere than a part.

        Raises
        ------
        Refused
            When it is known to be another one, or a last part that came is larger.
        """
        if self._part_size is not None:
            if self._part_size != part_size:
                raise Refused("part_size")
            return
        if self._aside is not None and len(self._aside) > part_size:
            raise Refused("part_size")
        self._fix_part_size(part_size)
        self._place_aside()

    def _fix_part_size(self, part_size: int) -> None:
        self._part_size = part_size
        self._body_bytes = block_bytes(part_size * self.header.parts_max)

    def _place_aside(self) -> str:
        """Judge a last part that came before the size was known; return why it is refused."""
        aside, self._aside = self._aside, None
        assert self._part_size is not None
        last = self.header.parts_max - 1
        if aside is None:
            return ""
        if len(aside) <= self._part_size:
            self._place(last, aside)
            return ""
        self._arrived[last] = 0  # a right one may still come
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
        whose = part.obj if isinstance(part, memoryview) else None
        if self._block is None:
            wanted = self._part_size * self.header.parts_max
            self._block = self._pool.take_offered(whose, wanted) or self._pool.lease(wanted)
            self._view = memoryview(self._block)
        if whose is not self._block:
            self._view[start:end] = part
        if number == self.header.parts_max - 1:
            self._size = end
