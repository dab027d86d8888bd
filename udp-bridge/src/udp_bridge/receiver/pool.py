# SPDX-License-Identifier: Apache-2.0
"""Block pool: reusable buffers for message bodies. Fresh memory costs more than the copy into it.

A block is free when no view of it is left: the body of a delivered message keeps its block in use,
so no block is overwritten while it can be read. If a user keeps messages, the pool forgets their
blocks, and they are freed like other memory. Leasing takes constant time: only a few blocks of the
right size are tried. `limits` bounds how much open messages may take.
"""

from __future__ import annotations

from collections import OrderedDict
from itertools import islice
from typing import Dict, Optional

KEPT_BYTES = 40 << 20
"""Bytes of all blocks in a pool: the largest message that was delivered, the next one, and some."""
SMALLEST_KEPT = 1 << 16
"""Smaller blocks are allocated exactly and not kept: allocating them is cheap."""
PROBES = 4
"""Blocks of a size class that are tried: the last ones used, which are in the cache."""
_WASTE = 2
"""A block may be this many times larger than requested."""


class BlockPool:
    """Blocks of one receiver, for use in one thread."""

    def __init__(self, kept_bytes: int = KEPT_BYTES) -> None:
        self.kept_bytes = 0
        """Bytes of all blocks in the pool, in use or not."""
        self._limit_bytes = kept_bytes
        self._blocks: OrderedDict[int, bytearray] = OrderedDict()  # by id; the last one used last
        self._classes: Dict[int, OrderedDict[int, bytearray]] = {}  # the same, by size
        self._offered: Optional[bytearray] = None
        self._offered_view = memoryview(b"")

    def lease(self, size: int) -> bytearray:
        """Return a block of at least `size` bytes; it is in use while there are views of it."""
        if size < SMALLEST_KEPT:
            return bytearray(block_bytes(size))
        for size_class in (_class_of(size), _class_of(size) + 1):
            blocks = self._classes.get(size_class)
            for block in islice(reversed(blocks.values()), PROBES) if blocks else ():
                if _fits(block, size) and is_free(block):
                    self._blocks.move_to_end(id(block))
                    self._classes[size_class].move_to_end(id(block))
                    return block
        block = bytearray(block_bytes(size))
        if len(block) <= self._limit_bytes:
            self._keep(block)
        return block

    def _keep(self, block: bytearray) -> None:
        self._blocks[id(block)] = block
        self._classes.setdefault(_class_of(len(block)), OrderedDict())[id(block)] = block
        self.kept_bytes += len(block)
        while self.kept_bytes > self._limit_bytes:
            key, oldest = self._blocks.popitem(last=False)
            del self._classes[_class_of(len(oldest))][key]
            self.kept_bytes -= len(oldest)

    def offer(self, size: int) -> bytearray:
        """Return the block to receive the next message into; there is one such block at a time."""
        offered = self._offered
        if offered is None or not _fits(offered, size):
            self._offered_view = memoryview(b"")
            offered = self._offered = self.lease(size)
            self._offered_view = memoryview(offered)
        return offered

    def take_offered(self, block: object, size: int) -> Optional[bytearray]:
        """Return the offered block if it is `block` and fits; the caller must keep a view of it."""
        offered = self._offered
        if offered is None or offered is not block or not _fits(offered, size):
            return None
        self._offered = None
        self._offered_view = memoryview(b"")
        return offered


def block_bytes(size: int) -> int:
    """Return the size of a new block for `size` bytes; a reused one may be larger."""
    return size if size < SMALLEST_KEPT else -(-size // SMALLEST_KEPT) * SMALLEST_KEPT


def _fits(block: bytearray, size: int) -> bool:
    return size <= len(block) <= size * _WASTE + SMALLEST_KEPT


def _class_of(size: int) -> int:
    """Return the size class; blocks of up to twice the size are in this class or the next one."""
    return size.bit_length()


def is_free(block: bytearray) -> bool:
    """Tell whether no view of a block is left: only then can a bytearray change its size."""
    try:
        block.append(block.pop())
    except BufferError:
        return False
    return True
