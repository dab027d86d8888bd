# SPDX-License-Identifier: Apache-2.0
"""Runs of datagrams from and to a socket: many in a call where `_runs` was built, else one.

What is received goes where `placing` expects it. Without the module, without sockets as POSIX has
them, or with UDP_BRIDGE_PLAIN=1 in the environment, each datagram is a call of its own; what
comes out is the same. No rule of the wire is known here.
"""

from __future__ import annotations

import os
import socket
import struct
from typing import Any, Callable, List, Optional, Tuple, Union

from udp_bridge.receiver.receive_slots import CreditState, PartBatch, ReceiveSlots
from udp_bridge.sender.outgoing import Order
from udp_bridge.sender.outgoing import Run as Leaving
from udp_bridge.wire.fragments import datagram_of
from udp_bridge.wire.header import PART_NUMBER_OFFSET
from udp_bridge.wire.message import Address

from .credit_mailbox import Kept

_many: Any = None
if os.environ.get("UDP_BRIDGE_PLAIN") is None:
    try:
        from .native import _runs as _many  # type: ignore[attr-defined,no-redef]
    except ImportError:
        pass

IS_BUILT = _many is not None
"""Whether runs can be sent and received at once."""
_SO_RXQ_OVFL = 40
_COUNT = struct.Struct("=I")
_REST_ROOM = 1 << 16

Complain = Callable[[int], bool]
Received = Tuple[Optional[PartBatch], int]
"""What came, and the errno that ended it or 0."""


class ManyAtOnce:
    """By `_runs`; one thread's."""

    def __init__(self) -> None:
        self.drops = 0
        """Datagrams that the kernel dropped for want of buffer, as far as it told."""
        self._rest = bytearray(_REST_ROOM)
        self._is_flowing = False
        self._parking: bytearray = _many.parking()

    def park(self, to: Address, like: bytes) -> List[Kept]:
        """As `UdpSocket.park_credits`."""
        kept: List[Kept] = _many.park(self._parking, to, like)
        return kept

    def parked(self, is_awaited: bool) -> List[Kept]:
        """As `UdpSocket.parked_credits`."""
        kept: List[Kept] = _many.parked(self._parking, is_awaited)
        return kept

    def order(self, order: Order) -> None:
        """As `UdpSocket.order_run`."""
        parts = order.parts
        _many.order(
            self._parking, order.to, parts.packed, parts.body, parts.cut.part_size, *order[2:]
        )

    def taken_back(self) -> int:
        """As `UdpSocket.order_taken_back`."""
        sent: int = _many.taken_back(self._parking)
        return sent

    def receive(self, source: socket.socket, place: ReceiveSlots, credits: CreditState) -> Received:
        """Return what came, at least one datagram; None when there was none."""
        found = _many.receive(
            source.fileno(), self._rest, *place, *credits, self._is_flowing, self._parking
        )
        self._is_flowing = found is not None
        if found is None:
            return None, -1
        run, error, drops = found
        if drops >= 0:
            self.drops = drops
        return tuple.__new__(PartBatch, run), error  # as `PartBatch._make`, in one step less


class OneByOne:
    """By recvmsg_into, for every system."""

    def __init__(self) -> None:
        self.drops = 0
        """Datagrams that the kernel dropped for want of buffer, as far as it told."""
        self._rest = bytearray(_REST_ROOM)

    def receive(self, source: socket.socket, place: ReceiveSlots, credits: CreditState) -> Received:
        """Return what came, a single datagram; None when there was none."""
        room = place.part_size if place.arrived else 0
        head = bytearray(len(place.header) if place.arrived else 0)
        start = place.next_part * place.part_size
        with memoryview(place.block)[start : start + room] as slot:
            buffers: List[Union[bytearray, memoryview]] = [head, slot, self._rest]
            try:
                size, ancillary, _, sender = source.recvmsg_into(buffers, 64)
            except OSError as error:
                return None, error.errno or -1
            if sender is None:  # so does the kernel tell that the socket was shut
                return None, -1
            for level, kind, data in ancillary:
                if level == socket.SOL_SOCKET and kind == _SO_RXQ_OVFL:
                    (self.drops,) = _COUNT.unpack(data)
            if size > len(head) and place.matches(bytes(head), size, sender):
                number, body_size = head[PART_NUMBER_OFFSET], size - len(head)
                if number != place.next_part:
                    start = number * place.part_size
                    with memoryview(place.block)[start : start + body_size] as there:
                        there[:] = slot[:body_size]
                is_last = number == len(place.arrived) - 1
                last_size = body_size if is_last else place.part_size
                uncredited = credits.uncredited_bytes + size
                run = PartBatch(bytes(head), ((number, 1),), last_size, 0, uncredited, None, None)
                return run, 0
            beyond = max(0, size - len(head) - room)
            stray = b"".join((head, slot, memoryview(self._rest)[:beyond]))[:size]
        return PartBatch(b"", (), 0, 0, credits.uncredited_bytes, stray, sender), 0


class SendingMany:
    """By `_runs`."""

    def send(self, source: socket.socket, run: Leaving, to: Address, complain: Complain) -> int:
        """Send a run; return how many of it the kernel took.

        When it does not take one, `complain` is told the errno and says whether to try again.
        """
        fd, parts = source.fileno(), run.parts
        number, end, sent, is_again = run.first, run.first + run.parts_count, 0, False
        while number < end:
            count, error = _many.send(
                fd, to, parts.packed, parts.body, parts.cut.part_size, number, end - number
            )
            number, sent = number + count, sent + count
            if count:
                is_again = False
            if error:
                is_again = complain(error) and not is_again
                number += not is_again  # without this one
        return sent


class SendingOne:
    """By sendmsg, for every system."""

    def send(self, source: socket.socket, run: Leaving, to: Address, complain: Complain) -> int:
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
