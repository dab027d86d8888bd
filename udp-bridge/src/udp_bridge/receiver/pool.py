# SPDX-License-Identifier: Apache-2.0
"""Buffers for bodies that are used again: fresh memory costs more than the copy into it.

A block is free again when nothing looks into it any more: views of a message that was handed
over keep its block, and none is ever written to while somebody may read it. Not here: how much a
receiver may hold (`holdings`). A user who keeps messages keeps their memory; the pool then
forgets those blocks and they are freed like any other memory. To lease takes the same time
however many blocks there are: only a few of the right size are tried.
"""

from __future__ import annotations

from collections import OrderedDict
from itertools import islice
from typing import Dict, Optional

KEPT_BYTES = 40 << 20
"""What a pool keeps: the largest message that was handed over, the next one, and some."""
SMALLEST_KEPT = 1 << 16
"""Smaller blocks are as large as is asked for, and not kept: fresh ones are cheap."""
PROBES = 4
"""Blocks of a class that are tried: the last ones used, which are in the cache."""
_WASTE = 2
"""A block may be this many times larger than what is asked for."""


class Pool:
    """Blocks of one receiver; to be used by one thread."""

    def __init__(self, kept_bytes: int = KEPT_BYTES) -> None:
        self.kept_bytes = 0
        """Bytes of all blocks that the pool knows, in use or not."""
        self._most_bytes = kept_bytes
        self._blocks: OrderedDict[int, bytearray] = OrderedDict()  # by id; the last one used last
        self._classes: Dict[int, OrderedDict[int, bytearray]] = {}  # the same, by size
        self._offered: Optional[bytearray] = None
        self._offered_view = memoryview(b"")

    def lease(self, size: int) -> bytearray:
        """Return a block of at least `size` bytes, with whatever is in it.

        It stays taken while there are views of it.
        """
        if size < SMALLEST_KEPT:
            return bytearray(block_bytes(size))
        for size_class in (_class_of(size), _class_of(size) + 1):
            alike = self._classes.get(size_class)
            for block in islice(reversed(alike.values()), PROBES) if alike else ():
                if _fits(block, size) and is_free(block):
                    self._blocks.move_to_end(id(block))
                    self._classes[size_class].move_to_end(id(block))
                    return block
        block = bytearray(block_bytes(size))
        if len(block) <= self._most_bytes:
            self._keep(block)
        return block

    def _keep(self, block: bytearray) -> None:
        self._blocks[id(block)] = block
        self._classes.setdefault(_class_of(len(block)), OrderedDict())[id(block)] = block
        self.kept_bytes += len(block)
        while self.kept_bytes > self._most_bytes:
            place, oldest = self._blocks.popitem(last=False)
            del self._classes[_class_of(len(oldest))][place]
            self.kept_bytes -= len(oldest)

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


def block_bytes(size: int) -> int:
    """Return the bytes of a fresh block; one that is used again may be larger, but is known."""
    return size if size < SMALLEST_KEPT else -(-size // SMALLEST_KEPT) * SMALLEST_KEPT


def _fits(block: bytearray, size: int) -> bool:
    return size <= len(block) <= size * _WASTE + SMALLEST_KEPT


def _class_of(size: int) -> int:
    """Return the class of blocks of a size; those of up to twice the size are in it or the next."""
    return size.bit_length()


def is_free(block: bytearray) -> bool:
    """Tell whether no view of a block is left: only then may a bytearray change its size."""
    try:
        block.append(block.pop())
    except BufferError:
        return False
    return True
