# SPDX-License-Identifier: Apache-2.0
"""Sockets around a link's socket: what they refuse never reaches reassembly.

Each is a `DatagramSocket` and stands around another one. A refused datagram is raised as
`Refused` by `receive_into`, so that the link counts it like any other.
"""

from __future__ import annotations

import os
import threading
import time
from typing import Iterable, List, Optional, Sequence, Tuple

from udp_bridge.receiver.receive_slots import CreditState, PartBatch, ReceiveSlots
from udp_bridge.wire.header import Buffer, Refused
from udp_bridge.wire.message import Address
from udp_bridge.wire.seal import OVERHEAD, Seal

from .credit_mailbox import Kept
from .udp_socket import DatagramSocket


class Around:
    """What all of them pass on."""

    def __init__(self, inner: DatagramSocket) -> None:
        self._inner = inner
        self.address: Address = inner.address
        self.receive_buffer: int = inner.receive_buffer
        self.overhead: int = inner.overhead

    @property
    def kernel_drops(self) -> int:
        """As `UdpSocket` has it."""
        return self._inner.kernel_drops

    @property
    def unreachable(self) -> int:
        """As `UdpSocket` has it."""
        return self._inner.unreachable

    def receive_into(self, buffer: bytearray) -> Optional[Tuple[int, Address]]:
        """Wait for a datagram; return its size and sender, or None when there was none."""
        return self._inner.receive_into(buffer)

    def send(self, buffers: Sequence[Buffer], to: Address) -> bool:
        """Send one datagram gathered from `buffers`; return whether the kernel took it."""
        return self._inner.send(buffers, to)

    def shut(self) -> None:
        """Wake the thread that receives."""
        self._inner.shut()

    def close(self) -> None:
        """Give the socket back."""
        self._inner.close()


class PeersOnly(Around):
    """Takes datagrams from certain addresses alone.

    Parameters
    ----------
    peers
        Numeric hosts with ports; port 0 stands for every port of the host.
    """

    def __init__(self, inner: DatagramSocket, peers: Iterable[Address]) -> None:
        super().__init__(inner)
        self._peers = frozenset(peers)  # replaced as a whole, for another thread receives
        if hasattr(inner, "send_run"):  # what is sent passes as it is
            self.send_run = inner.send_run
        if hasattr(inner, "receive_run"):
            self._inner_run = inner.receive_run
            self.receive_run = self._receive_run
        if hasattr(inner, "park_credits"):
            self._inner_park = inner.park_credits
            self.park_credits = self._park_credits
        if hasattr(inner, "parked_credits"):
            self.parked_credits = inner.parked_credits
        if hasattr(inner, "order_run"):
            self.order_run = inner.order_run
        if hasattr(inner, "order_taken_back"):
            self.order_taken_back = inner.order_taken_back

    def vouch(self, address: Address) -> None:
        """Take datagrams from an address, too: the user sends there."""
        self._peers |= {address}

    def receive_into(self, buffer: bytearray) -> Optional[Tuple[int, Address]]:
        """Wait for a datagram; return its size and sender, or None when there was none.

        Raises
        ------
        Refused
            When it came from elsewhere.
        """
        received = self._inner.receive_into(buffer)
        if received is not None:
            if not self._is_peer(received[1]):
                raise Refused("stranger")
        return received

    def close(self) -> None:
        """Give the socket back."""
        super().close()
        for name in ("receive_run", "park_credits"):  # they refer to this object itself
            self.__dict__.pop(name, None)

    def _receive_run(self, place: ReceiveSlots, credits: CreditState) -> Optional[PartBatch]:
        """Do as `UdpSocket.receive_run`; parts are expected of those alone who were let in."""
        run: Optional[PartBatch] = self._inner_run(place, credits)
        if (
            run is not None
            and run.unmatched_sender is not None
            and not self._is_peer(run.unmatched_sender)
        ):
            run = run._replace(unmatched=None, unmatched_sender=None, refused="stranger")
        return run

    def _park_credits(self, to: Address, like: bytes) -> List[Kept]:
        """Do as `UdpSocket.park_credits`, but let those of others be refused."""
        kept: List[Kept] = []
        if self._is_peer(to):
            kept = self._inner_park(to, like)
        return kept

    def _is_peer(self, sender: Address) -> bool:
        return sender in self._peers or (sender[0], 0) in self._peers


class Sealed(Around):
    """Sends and takes sealed datagrams alone.

    Parameters
    ----------
    secret
        What both ends share; see `keys`.
    sends
        `seal.TO_ROS` or `seal.FROM_ROS`, what this end sends.
    """

    def __init__(self, inner: DatagramSocket, secret: bytes, *, sends: int) -> None:
        super().__init__(inner)
        self.overhead += OVERHEAD
        sender = int.from_bytes(os.urandom(4), "little")
        self._seal = Seal(secret, sends=sends, sender=sender)
        self._counting = threading.Lock()  # a link sends in two threads
        self._came = bytearray(1 << 16)

    def receive_into(self, buffer: bytearray) -> Optional[Tuple[int, Address]]:
        """Wait for a datagram; return the size of the one within and its sender, or None.

        Raises
        ------
        Refused
            When what came must not be trusted.
        """
        received = self._inner.receive_into(self._came)
        if received is None:
            return None
        size, sender = received
        plain = self._seal.opened(memoryview(self._came)[:size], time.time_ns())
        buffer[: len(plain)] = plain
        return len(plain), sender

    def send(self, buffers: Sequence[Buffer], to: Address) -> bool:
        """Send one datagram, sealed; return whether the kernel took it."""
        with self._counting:
            counter = self._seal.next_counter(time.time_ns())
        return self._inner.send(self._seal.sealed(buffers, counter), to)
