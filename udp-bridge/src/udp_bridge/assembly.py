# SPDX-License-Identifier: Apache-2.0
"""One message's parts on their way to a body. No other message, no order, no time limit.

The first copy of a part counts, and the first part that is not the last fixes the part size.
The buffer grows with what really arrived, never with what a header announces.
"""

from __future__ import annotations

from typing import NamedTuple, Optional

from .header import Buffer, Header, Refused


class Added(NamedTuple):
    """What became of a part that was not refused itself."""

    is_duplicate: bool = False
    refused: str = ""
    """Why the last part, which had come before this one, was refused now."""


class Assembly:
    """The parts of one message of more than one part."""

    __slots__ = ("_arrived", "_aside", "_buffer", "_part_size", "header", "parts_in", "since_nanos")

    def __init__(self, header: Header, since_nanos: int) -> None:
        self.header = header
        self.since_nanos = since_nanos
        """When its first part came."""
        self.parts_in = 0
        self._arrived = bytearray(header.parts_max)
        self._buffer = bytearray()
        self._part_size: Optional[int] = None
        self._aside: Optional[bytes] = None  # a last part that came before the size was known

    @property
    def complete(self) -> bool:
        """Whether all parts are in."""
        return self.parts_in == self.header.parts_max

    @property
    def announced_bytes(self) -> int:
        """What the message will take at most, or, while only its last part is in, at least."""
        size = self._part_size if self._part_size is not None else len(self._aside or b"")
        return size * self.header.parts_max

    @property
    def body(self) -> memoryview:
        """The whole body, read-only; of use once `complete`."""
        return memoryview(self._buffer).toreadonly()

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
                self._part_size = len(part)
                refused = self._place_aside()
            self._check_size(len(part), is_last)
            self._place(number, part)
        self._arrived[number] = 1
        self.parts_in += 1
        return Added(refused=refused)

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
        gap = start - len(self._buffer)
        if gap > 0:
            self._buffer += bytes(gap)
        if gap >= 0:  # in order: the part is written once, into memory nobody filled before
            self._buffer += part
        else:
            with memoryview(self._buffer) as view:
                view[start : start + len(part)] = part
