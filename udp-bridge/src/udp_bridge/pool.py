# SPDX-License-Identifier: Apache-2.0
"""Buffers for bodies that are used again: fresh memory costs more than the copy into it.

A block is free again when nothing looks into it any more: views of a message that was handed
over keep its block, and none is ever written to while somebody may read it. Not here: how much a
message may announce (`holdings`). A user who keeps messages keeps their memory; the pool then
forgets those blocks and they are freed like any other memory.
"""

from __future__ import annotations

from typing import List, Optional

KEPT_BYTES = 40 << 20
"""What a pool keeps: the largest message that was handed over, the next one, and some."""
_STEP = 1 << 16
_WASTE = 2
"""A block may be this many times larger than what is asked for."""


class Pool:
    """Blocks of one receiver; to be used by one thread."""

    def __init__(self, kept_bytes: int = KEPT_BYTES) -> None:
        self._kept_bytes = kept_bytes
        self._blocks: List[bytearray] = []
        self._offered: Optional[bytearray] = None
        self._offered_view = memoryview(b"")

    @property
    def kept_bytes(self) -> int:
        """Bytes of all blocks that the pool knows, in use or not."""
        return sum(map(len, self._blocks))

    def lease(self, size: int) -> bytearray:
        """Return a block of at least `size` bytes, with whatever is in it.

        It stays taken while there are views of it.
        """
        for index in range(len(self._blocks) - 1, -1, -1):  # the last one used is in the cache
            block = self._blocks[index]
            if _fits(block, size) and is_free(block):
                self._blocks.append(self._blocks.pop(index))
                return block
        block = bytearray(-(-size // _STEP) * _STEP)
        if len(block) <= self._kept_bytes:
            self._blocks.append(block)
            while self.kept_bytes > self._kept_bytes:
                del self._blocks[0]
        return block

    def offer(self, size: int) -> bytearray:
        """Return a block to receive a message into that nobody knows yet; one at a time."""
        offered = self._offered
        if offered is None or not _fits(offered, size):
            self._offered_view = memoryview(b"")
            offered = self._offered = self.lease(size)
            self._offered_view = memoryview(offered)
        return offered

    def take_offered(self, block: object, size: int) -> Optional[bytearray]:
        """Give the offered block away, if it is `block` and fits; the taker must view it."""
        offered = self._offered
        if offered is None or offered is not block or not _fits(offered, size):
            return None
        self._offered = None
        self._offered_view = memoryview(b"")
        return offered


def _fits(block: bytearray, size: int) -> bool:
    return size <= len(block) <= size * _WASTE + _STEP


def is_free(block: bytearray) -> bool:
    """Tell whether no view of a block is left: only then may a bytearray change its size."""
    try:
        block.append(block.pop())
    except BufferError:
        return False
    return True
