# SPDX-License-Identifier: Apache-2.0
"""Socket wrappers: filter or seal the datagrams of a link's socket.

Each wrapper is a `DatagramSocket` around another one. `receive_into` raises `Refused` for a
rejected datagram, so that the link counts it like any other refused datagram.
"""

from __future__ import annotations

import os
import threading
import time
from typing import Iterable, Optional, Sequence, Tuple

from udp_bridge.receiver.receive_slots import CreditState, PartBatch, ReceiveSlots
from udp_bridge.wire.header import Buffer, Refused
from udp_bridge.wire.message import Address
from udp_bridge.wire.seal import OVERHEAD, Seal

from .udp_socket import DatagramSocket, Received, UdpSocket


class SocketWrapper:
    """Passes everything on to the socket within; base class of the wrappers."""

    def __init__(self, inner: DatagramSocket) -> None:
        self._inner = inner
        self.address: Address = inner.address
        self.receive_buffer: int = inner.receive_buffer
        self.overhead: int = inner.overhead

    @property
    def kernel_drops(self) -> int:
        """See `UdpSocket`."""
        return self._inner.kernel_drops

    @property
    def unreachable(self) -> int:
        """See `UdpSocket`."""
        return self._inner.unreachable

    def receive_into(self, buffer: bytearray) -> Optional[Tuple[int, Address]]:
        """Wait for a datagram; return its size and sender, or None if nothing was received."""
        return self._inner.receive_into(buffer)

    def send(self, buffers: Sequence[Buffer], to: Address) -> bool:
        """Send one datagram gathered from `buffers`; return whether the kernel took it."""
        return self._inner.send(buffers, to)

    def shut(self) -> None:
        """Wake the receiving thread."""
        self._inner.shut()

    def close(self) -> None:
        """Close the socket."""
        self._inner.close()


class _Peers:
    """Addresses that may send; port 0 stands for every port of the host."""

    def __init__(self, peers: Iterable[Address]) -> None:
        self._peers = frozenset(peers)

    def add(self, address: Address) -> None:
        self._peers |= {address}  # replaced as a whole, because another thread receives

    def __contains__(self, sender: object) -> bool:
        assert isinstance(sender, tuple)
        return sender in self._peers or (sender[0], 0) in self._peers


class PeerFilter(SocketWrapper):
    """Receives from certain addresses only.

    Parameters
    ----------
    peers
        Numeric hosts with ports; port 0 stands for every port of the host.
    """

    def __init__(self, inner: UdpSocket, peers: Iterable[Address]) -> None:
        super().__init__(inner)
        self._peers = _Peers(peers)
        self._receive_inner = inner.receive_batch
        self.use_small_topics = inner.use_small_topics  # of senders that were received before
        self.send_small, self.send_large = inner.send_small, inner.send_large
        self.send_batch = inner.send_batch
        self.credit_store = inner.credit_store
        if self.credit_store is not None:
            self.credit_store.peers = self._peers

    def trust(self, address: Address) -> None:
        """Receive from an address, too, because the user sends to it."""
        self._peers.add(address)

    def receive_into(self, buffer: bytearray) -> Optional[Tuple[int, Address]]:
        """Wait for a datagram; return its size and sender, or None if nothing was received.

        Raises
        ------
        Refused
            When it came from another address.
        """
        received = self._inner.receive_into(buffer)
        if received is not None and received[1] not in self._peers:
            raise Refused("stranger")
        return received

    def receive_batch(self, slots: ReceiveSlots, credits: CreditState) -> Received:
        """See `UdpSocket.receive_batch`; parts are only predicted of peers."""
        batch = self._receive_inner(slots, credits)
        if isinstance(batch, PartBatch) and batch.unmatched_sender is not None:
            if batch.unmatched_sender not in self._peers:
                return batch._replace(unmatched=None, unmatched_sender=None, refused="stranger")
        return batch


class SealedSocket(SocketWrapper):
    """Sends and receives sealed datagrams only; see `seal`.

    Parameters
    ----------
    secret
        The key that both ends share; see `keys`.
    sends
        `seal.TO_ROS` or `seal.FROM_ROS`: the direction in which this end sends.
    """

    def __init__(self, inner: DatagramSocket, secret: bytes, *, sends: int) -> None:
        super().__init__(inner)
        self.overhead += OVERHEAD
        sender = int.from_bytes(os.urandom(4), "little")
        self._seal = Seal(secret, sends=sends, sender=sender)
        self._counter_lock = threading.Lock()  # several threads of a link send
        self._sealed = bytearray(1 << 16)

    def receive_into(self, buffer: bytearray) -> Optional[Tuple[int, Address]]:
        """Wait for a datagram; return the size of the plain one and its sender, or None.

        Raises
        ------
        Refused
            When its seal is wrong.
        """
        received = self._inner.receive_into(self._sealed)
        if received is None:
            return None
        size, sender = received
        plain = self._seal.opened(memoryview(self._sealed)[:size], time.time_ns())
        buffer[: len(plain)] = plain
        return len(plain), sender

    def send(self, buffers: Sequence[Buffer], to: Address) -> bool:
        """Seal and send one datagram; return whether the kernel took it."""
        with self._counter_lock:
            counter = self._seal.next_counter(time.time_ns())
        return self._inner.send(self._seal.sealed(buffers, counter), to)
