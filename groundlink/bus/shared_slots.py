# SPDX-License-Identifier: Apache-2.0
"""Shared memory for large messages of a local stream.

The sender writes a message into a slot, a sealed memfd that both processes map, and sends a frame
by the socket that says where; with the first one the memfd. The receiver reads the message in
place. When it has dropped all views of the message, it marks the slot as free, and the slot is used
again: new pages would take many times as long as the copy. Slots have no names in a file system.
The kernel frees them when both processes have closed them or have ended, however they end.
"""

import fcntl
import mmap
import os
import struct
import weakref
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .channel import Payload

POOL_BYTES = 64 << 20
"""Most bytes of the slots of one receiver; more only for `FEWEST_SLOTS` of larger messages."""

FEWEST_SLOTS, MOST_SLOTS = 4, 64

MOST_HELD = 2
"""Messages that a receiver reads in place. It copies more, so that the sender has free slots even
if the receiver keeps messages for long."""

_STATE = 0
"""Place of a slot's state: a byte, 0 if the slot is free."""

_HEADROOM = 4096
"""Bytes before the largest piece of a message. The receiver may overwrite them, and those behind
the message, once it has decoded the message; but for the first ones."""

_KEPT = 64
_TAILROOM = 64
_GRANULE = 1 << 16
"""Sizes of slots are multiples of this."""

_SEALS = fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_SEAL

_MARK = 0xC1
"""First byte of a frame. No MessagePack begins with it."""

_FRAME = struct.Struct("<BBQQ")
"""Mark, number of the slot, where its message begins, and the message's bytes."""

Pieces = Sequence[Payload]
"""Pieces of a payload, one after the other."""


class SocketFrame(NamedTuple):
    """What is sent by a socket: a small message, or where a large one is."""

    content: bytes
    file: int | None = None
    """The memfd of a slot that the receiver does not have yet."""


def is_frame(content: bytes) -> bool:
    """Return whether what came by a socket says where a message is."""
    return content[:1] == bytes((_MARK,))


class _Slot:
    """A slot as its sender has it, with room for somewhat larger messages."""

    def __init__(self, size: int) -> None:
        self.size = -(-(size + size // 8) // _GRANULE) * _GRANULE
        self.is_shared = False
        """Whether the receiver has been sent the memfd."""

        self.file = os.memfd_create("groundlink", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
        os.ftruncate(self.file, self.size)
        fcntl.fcntl(self.file, fcntl.F_ADD_SEALS, _SEALS)
        self.memory = mmap.mmap(self.file, self.size)

    def write(self, pieces: Pieces) -> tuple[int, int]:
        """Write a payload; return where it begins and its size."""
        largest = max(range(len(pieces)), key=lambda number: len(pieces[number]))
        before = sum(map(len, pieces[:largest]))
        end = start = max(_HEADROOM, before + _KEPT) - before
        for piece in pieces:
            self.memory[end : end + len(piece)] = piece
            end += len(piece)
        self.memory[_STATE] = 1
        return start, end - start

    def close(self) -> None:
        self.memory.close()
        os.close(self.file)


class SlotPool:
    """The slots of one receiver, at the sender."""

    def __init__(self) -> None:
        self._slots: list[_Slot] = []

    def write(self, pieces: Pieces) -> SocketFrame | None:
        """Write a payload into a free slot; return its frame, or None if no slot is free."""
        number = self._free_slot(_HEADROOM + _KEPT + sum(map(len, pieces)) + _TAILROOM)
        if number is None:
            return None
        slot = self._slots[number]
        frame = _FRAME.pack(_MARK, number, *slot.write(pieces))
        file = None if slot.is_shared else slot.file
        slot.is_shared = True
        return SocketFrame(frame, file)

    def withdraw(self, frame: SocketFrame) -> None:
        """Free the slot of a frame, if it is one of a slot, that will not be sent."""
        if is_frame(frame.content):
            slot = self._slots[frame.content[1]]
            slot.memory[_STATE] = 0
            slot.is_shared = frame.file is None

    def close(self) -> None:
        """Close all slots; the receiver's views stay valid."""
        for slot in self._slots:
            slot.close()
        self._slots.clear()

    def _free_slot(self, size: int) -> int | None:
        """Return the number of a free slot of at least this size, if possible one used before."""
        for number, slot in enumerate(self._slots):
            if slot.memory[_STATE] == 0:
                if slot.size < size:
                    slot.close()
                    self._slots[number] = _Slot(size)
                return number
        count, size_of_all = len(self._slots), sum(slot.size for slot in self._slots)
        if count >= FEWEST_SLOTS and (count == MOST_SLOTS or size_of_all + size > POOL_BYTES):
            return None
        self._slots.append(_Slot(size))
        return count


class SharedBlock(np.ndarray[tuple[int], np.dtype[np.uint8]]):
    """A slot with a message that its receiver reads. Views of the message keep it alive."""


class SlotReader:
    """The slots of one sender, at the receiver."""

    def __init__(self) -> None:
        self._slots: dict[int, NDArray[np.uint8]] = {}
        self._held: dict[int, weakref.ref[SharedBlock]] = {}
        """Slots of which views exist."""

    def payload(self, frame: bytes, files: Sequence[int]) -> Payload | None:
        """Return the payload that a frame announces; None if its slot cannot be read.

        Parameters
        ----------
        files
            memfds that came with it; they are closed.
        """
        _, number, start, size = _FRAME.unpack(frame)
        for file in files:
            self._map(number, file)
        slot = self._slots.get(number)
        if slot is None or start + size > slot.size:
            return None
        if len(self._held) == MOST_HELD:
            copied = slot[start : start + size].tobytes()
            slot[_STATE] = 0
            return copied
        block = slot.view(SharedBlock)

        def give_back(_: object) -> None:
            self._held.pop(number, None)
            slot[_STATE] = 0

        self._held[number] = weakref.ref(block, give_back)
        return memoryview(block)[start : start + size]  # type: ignore[arg-type]

    def _map(self, number: int, file: int) -> None:
        """Map a memfd that cannot shrink, as the memory of a slot."""
        try:
            if fcntl.fcntl(file, fcntl.F_GET_SEALS) & _SEALS == _SEALS:
                self._slots[number] = np.frombuffer(mmap.mmap(file, 0), np.uint8)
        except (OSError, ValueError):  # no memfd, no memory, or an empty file
            self._slots.pop(number, None)
        finally:
            os.close(file)


class RoomAround(NamedTuple):
    """Where an array of a received message lies in its slot."""

    block: SharedBlock
    start: int
    size: int

    def enclose(self, head: bytes, tail: bytes) -> memoryview:
        """Write bytes before the array and behind it, over the message that it was a part of.

        Returns
        -------
        All of these bytes, which keep the slot.
        """
        first, end = self.start - len(head), self.start + self.size
        assert first >= _KEPT
        assert len(tail) <= _TAILROOM
        block = memoryview(self.block)  # type: ignore[arg-type]
        block[first : self.start] = head
        block[end : end + len(tail)] = tail
        return block[first : end + len(tail)]


def room_around(array: NDArray[np.uint8]) -> RoomAround | None:
    """Return where an array of a received message lies; None if it is not in a slot."""
    owner: Any = array
    while isinstance(owner, np.ndarray) and not isinstance(owner, SharedBlock):
        owner = owner.base
    block = owner.obj if isinstance(owner, memoryview) else owner
    if not isinstance(block, SharedBlock):
        return None
    return RoomAround(block, array.ctypes.data - block.ctypes.data, array.size)
