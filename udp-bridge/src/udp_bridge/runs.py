# SPDX-License-Identifier: Apache-2.0
"""Runs of datagrams from and to a socket: many in a call where the system can, else one by one.

What is received lands in a slot of `placing`: header apart, body in its place. What a datagram
has beyond its slot lies in a rest of its own. No rule of the wire is known here.
"""

from __future__ import annotations

import errno
import socket
import struct
from typing import Callable, List, Optional, Tuple, Union

from . import mmsg
from .fragments import Parts, datagram_of
from .header import PART_NUMBER_OFFSET
from .placing import MOST_AT_ONCE, Run, Slots
from .sending import Address
from .sending import Run as Leaving

_SO_RXQ_OVFL = 40
_COUNT = struct.Struct("=I")
_CMSG_HEADER = 16
_REST_ROOM = 1 << 16


class ManyAtOnce:
    """By recvmmsg; one thread's."""

    def __init__(self) -> None:
        self.drops = 0
        """Datagrams that the kernel dropped for want of buffer, as far as it told."""
        self._table = mmsg.Table(3)
        self._heads = bytearray(mmsg.HEADER_ROOM * mmsg.ENTRIES)
        self._rest = bytearray(_REST_ROOM * MOST_AT_ONCE)
        self._shape: Tuple[int, int, int] = (0, 0, 0)
        self._block: Optional[bytearray] = None
        self._is_flowing = False
        self._heads_at = mmsg.address_of(self._heads)
        self._table.fill(5, 0, _REST_ROOM, mmsg.ENTRIES, 0)
        rest = mmsg.address_of(self._rest)
        for first in range(0, mmsg.ENTRIES, MOST_AT_ONCE):
            self._table.fill(4, first, rest, MOST_AT_ONCE, _REST_ROOM)

    def receive(self, source: socket.socket, slots: Slots) -> Optional[Run]:
        """Return what came, at least one datagram; None when there was none."""
        self._lay_out(slots)
        fd, first, count = source.fileno(), slots.first, slots.slot_count
        taken = 0
        if self._is_flowing:
            taken = mmsg.receive(fd, self._table, first, count, waits=False)
        if taken <= 0:
            taken = mmsg.receive(fd, self._table, first, count, waits=True)
        self._is_flowing = taken > 0
        if taken <= 0:
            return None
        control = self._table.control_of(first + taken - 1)
        if len(control) >= _CMSG_HEADER + _COUNT.size:
            (self.drops,) = _COUNT.unpack_from(control, _CMSG_HEADER)
        return _Many(slots, taken, self._table, self._heads, self._rest)

    def _lay_out(self, slots: Slots) -> None:
        shape = (slots.header_size, slots.part_size, slots.parts_max)
        if shape == self._shape and slots.block is self._block:
            return
        table, rows = self._table, slots.parts_max
        table.fill(0, 0, self._heads_at, rows, slots.header_size)
        table.fill(1, 0, slots.header_size, rows, 0)
        table.fill(2, 0, mmsg.address_of(slots.block), rows, slots.part_size)
        table.fill(3, 0, slots.part_size, rows, 0)
        self._shape, self._block = shape, slots.block


class _Many:
    def __init__(
        self, slots: Slots, count: int, table: mmsg.Table, heads: bytearray, rest: bytearray
    ) -> None:
        self.slots = slots
        self.count = count
        self._table = table
        self._heads = heads
        self._rest = rest

    def size(self, index: int) -> int:
        return self._table.sizes[self.slots.first + index]

    def head(self, index: int) -> bytes:
        start = (self.slots.first + index) * self.slots.header_size
        return bytes(self._heads[start : start + self.slots.header_size])

    def sender(self, index: int) -> Address:
        return self._table.sender(self.slots.first + index)

    def follows(self, index: int, heads: bytes, sizes: List[int]) -> bool:
        first, end = self.slots.first + index, self.slots.first + self.count
        size = self.slots.header_size
        return (
            self._heads[first * size : end * size] == heads
            and self._table.sizes[first:end].tolist() == sizes
            and self._table.has_one_sender(self.slots.first + max(0, index - 1), end)
        )

    def copy(self, index: int) -> bytes:
        row = self.slots.first + index
        rest = (row % MOST_AT_ONCE) * _REST_ROOM
        return _joined(
            self.size(index),
            self.head(index),
            self.slots,
            row,
            memoryview(self._rest)[rest : rest + _REST_ROOM],
        )


class OneByOne:
    """By recvmsg_into, for every system."""

    def __init__(self) -> None:
        self.drops = 0
        """Datagrams that the kernel dropped for want of buffer, as far as it told."""
        self._rest = bytearray(_REST_ROOM)

    def receive(self, source: socket.socket, slots: Slots) -> Optional[Run]:
        """Return what came, a single datagram; None when there was none."""
        head = bytearray(slots.header_size)
        start = slots.first * slots.part_size
        with memoryview(slots.block)[start : start + slots.part_size] as place:
            try:
                buffers: List[Union[bytearray, memoryview]] = [head, place, self._rest]
                size, ancillary, _, sender = source.recvmsg_into(buffers, 64)
            except OSError:
                return None
        for level, kind, data in ancillary:
            if level == socket.SOL_SOCKET and kind == _SO_RXQ_OVFL:
                (self.drops,) = _COUNT.unpack(data)
        return _One(slots, size, bytes(head), sender, self._rest)


class _One:
    count = 1

    def __init__(
        self, slots: Slots, size: int, head: bytes, sender: Address, rest: bytearray
    ) -> None:
        self.slots = slots
        self._size = size
        self._head = head
        self._sender = sender
        self._rest = rest

    def size(self, index: int) -> int:
        return self._size

    def head(self, index: int) -> bytes:
        return self._head

    def sender(self, index: int) -> Address:
        return self._sender

    def follows(self, index: int, heads: bytes, sizes: List[int]) -> bool:
        return self._head == heads and [self._size] == sizes

    def copy(self, index: int) -> bytes:
        return _joined(self._size, self._head, self.slots, self.slots.first, memoryview(self._rest))


def _joined(size: int, head: bytes, slots: Slots, row: int, rest: memoryview) -> bytes:
    """Return a datagram that lies in three places."""
    pieces: List[bytes] = [head[:size]]
    in_place = min(max(0, size - slots.header_size), slots.part_size)
    start = row * slots.part_size
    pieces.append(bytes(memoryview(slots.block)[start : start + in_place]))
    pieces.append(bytes(rest[: max(0, size - slots.header_size - slots.part_size)]))
    return b"".join(pieces)


class SendingMany:
    """By sendmmsg; one thread's."""

    def __init__(self) -> None:
        self._table = mmsg.Table(2)
        self._heads = bytearray(mmsg.HEADER_ROOM * mmsg.ENTRIES)
        self._heads_at = mmsg.address_of(self._heads)
        self._parts: Optional[Parts] = None
        self._to: Optional[Address] = None
        self._body: Optional[mmsg.Pinned] = None

    def send(
        self, source: socket.socket, run: Leaving, to: Address, complain: Callable[[int], bool]
    ) -> int:
        """Send a run; return how many of it the kernel took.

        When it does not take one, `complain` is told the errno and says whether to try again.
        """
        self._lay_out(run.parts, to)
        fd, number, end, sent = source.fileno(), run.first, run.first + run.parts_count, 0
        is_again = False
        while number < end:
            taken = mmsg.send(fd, self._table, number, end - number)
            if taken > 0:
                number += taken
                sent += taken
                is_again = False
            elif taken == -errno.EINTR or (complain(-taken) and not is_again):
                is_again = taken != -errno.EINTR
            else:
                number += 1
                is_again = False
        if end == run.parts.cut.parts_max:
            self._parts = self._body = None
        return sent

    def _lay_out(self, parts: Parts, to: Address) -> None:
        if to != self._to:
            self._table.set_receiver(to)
            self._to = to
        if parts is self._parts:
            return
        table, size, count = self._table, len(parts.packed), parts.cut.parts_max
        self._heads[: size * count] = parts.packed * count
        self._heads[PART_NUMBER_OFFSET : size * count : size] = bytes(range(count))
        self._body = mmsg.Pinned(parts.body)
        table.fill(0, 0, self._heads_at, count, size)
        table.fill(1, 0, size, count, 0)
        table.fill(2, 0, self._body.address, count, parts.cut.part_size)
        table.fill(3, 0, parts.cut.part_size, count, 0)
        last_size = parts.body.nbytes - (count - 1) * parts.cut.part_size
        table.fill(3, count - 1, last_size, 1, 0)
        self._parts = parts


class SendingOne:
    """By sendmsg, for every system."""

    def send(
        self, source: socket.socket, run: Leaving, to: Address, complain: Callable[[int], bool]
    ) -> int:
        """Send a run; return how many of it the kernel took."""
        parts, sent = run.parts, 0
        for number in range(run.first, run.first + run.parts_count):
            buffers = datagram_of(parts.packed, parts.body, parts.cut, number)
            for _ in range(2):
                try:
                    source.sendmsg(buffers, [], 0, to)
                    sent += 1
                    break
                except OSError as error:
                    if not complain(error.errno or 0):
                        break
        return sent
