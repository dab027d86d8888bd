# SPDX-License-Identifier: Apache-2.0
"""Opens a link's socket with the protection that its user configured: a peer, a key, or neither.

A socket that other hosts can reach, without a peer and without a key, validates addresses. It takes
data from any address, but refuses Subscribe and Barrier from addresses that are not validated, and
sends them no more bytes than it received from them.
"""

from __future__ import annotations

import os
import threading
import time
from typing import List, Optional, Sequence, Tuple

from udp_bridge.receiver.receive_slots import (
    NO_SLOTS,
    CreditState,
    PartBatch,
    ReceiveSlots,
)
from udp_bridge.receiver.small_topics import WholeMessage
from udp_bridge.sender.send_queue import OutgoingBatch
from udp_bridge.wire import control
from udp_bridge.wire.address_validation import (
    CHALLENGE_SIZE,
    AddressChallenge,
    AddressResponse,
    AddressValidator,
    is_local,
)
from udp_bridge.wire.control import Barrier, Subscribe
from udp_bridge.wire.header import Buffer, Header, Refused, parse
from udp_bridge.wire.message import Address
from udp_bridge.wire.types import CONTROL, SUBSCRIBE

from .socket_wrappers import PeerFilter, SealedSocket, SocketWrapper
from .udp_socket import RECOMMENDED_BUFFER, DatagramSocket, Received, UdpSocket, resolve

_WAIT_S = 0.1
_KEY_SIZE = 32
_CHALLENGE_HEAD = Header(CONTROL, 0, 0, 1, 0, 0).pack()
_ANSWER_BYTES = 4096
"""Upper bound of the Credits and the Request that a socket sends while it receives one batch."""


class Unguarded(ValueError):
    """Other hosts can reach a socket that has neither a peer nor a key; the text is one line."""


def open_socket(
    bind: Address,
    *,
    peer: Optional[Address] = None,
    secret: Optional[bytes] = None,
    sends: int,
    allow_any_peer: bool = False,
    receive_buffer: int = RECOMMENDED_BUFFER,
) -> DatagramSocket:
    """Return a bound socket with its protection.

    Parameters
    ----------
    peer
        The only sender whose datagrams are accepted; port 0 stands for every port of the host.
    secret
        The key that both ends share; see `SealedSocket`.
    sends
        `seal.TO_ROS` or `seal.FROM_ROS`.
    allow_any_peer
        Accept that other hosts can reach the socket although there is neither peer nor secret.

    Raises
    ------
    Unguarded
        When other hosts can reach the socket and neither peer nor secret is given.
    OSError
        When an address can't be resolved or bound.
    """
    allowed = resolve(peer) if peer is not None else None
    bare = UdpSocket(bind, receive_buffer=receive_buffer, wait_s=_WAIT_S)
    if allowed is None and secret is None and not allow_any_peer and not is_local(bare.address):
        bare.close()
        raise Unguarded(
            f"bind {bind[0]}:{bind[1]}: other hosts can reach this socket; expected a peer or a "
            "key. Fix: --peer HOST:PORT, --key-file FILE, or --allow-any-peer to accept datagrams "
            "from any address"
        )
    if secret is not None:
        filtered = PeerFilter(bare, [allowed]) if allowed is not None else bare
        return SealedSocket(filtered, secret, sends=sends)
    return guard(bare, allowed)


def guard(bare: UdpSocket, peer: Optional[Address]) -> DatagramSocket:
    """Return a bound socket with the wrapper that it needs; `peer` is numeric."""
    if peer is not None:
        return PeerFilter(bare, [peer])
    return bare if is_local(bare.address) else AddressGuard(bare)


class AddressGuard(SocketWrapper):
    """Validates addresses and limits what is sent to others; see `address_validation`."""

    def __init__(self, inner: UdpSocket) -> None:
        super().__init__(inner)
        self._validator = AddressValidator(os.urandom(_KEY_SIZE))
        self._trusted: List[Address] = []
        self._lock = threading.Lock()  # one thread receives while another sends
        self._receive_inner, self._send_inner = inner.receive_batch, inner.send_batch
        self.credit_store = inner.credit_store

    def trust(self, address: Address) -> None:
        """Send to an address without validating it, because the user named it."""
        self._trusted = [*self._trusted, address]

    def is_known(self, address: Address) -> bool:
        """Return whether an address is validated or trusted."""
        if address in self._trusted:
            return True
        with self._lock:
            return self._validator.is_validated(address, time.monotonic_ns())

    def receive_into(self, buffer: bytearray) -> Optional[Tuple[int, Address]]:
        """Wait for a datagram; return its size and sender, or None if nothing was received.

        Raises
        ------
        Refused
            When it requests what only a validated address gets.
        """
        received = self._inner.receive_into(buffer)
        if received is not None:
            self._examine(memoryview(buffer)[: received[0]], received[1])
        return received

    def receive_batch(self, slots: ReceiveSlots, credits: CreditState) -> Received:
        """See `UdpSocket.receive_batch`; unvalidated senders get few answers."""
        is_limited = bool(slots.arrived) and not self.is_known(slots.sender)
        if is_limited and self._validator.unsent(slots.sender) < _ANSWER_BYTES:
            slots, credits = NO_SLOTS, CreditState(0, self.receive_buffer, 0)
        batch = self._receive_inner(slots, credits)
        if isinstance(batch, WholeMessage):
            if is_limited:
                self._count_parts(slots, batch.header, batch.message.parts, is_answered=True)
            return batch
        if not isinstance(batch, PartBatch):  # no small topics are used here
            return None
        if batch.part_ranges and is_limited:
            is_answered = bool(batch.credits_sent or batch.nack_bitmap)
            self._count_parts(slots, batch.header, batch.parts_count, is_answered=is_answered)
        if batch.unmatched is not None and batch.unmatched_sender is not None:
            try:
                self._examine(memoryview(batch.unmatched), batch.unmatched_sender)
            except Refused as refused:
                return batch._replace(unmatched=None, unmatched_sender=None, refused=refused.reason)
        return batch

    def _count_parts(
        self, slots: ReceiveSlots, header: bytes, count: int, *, is_answered: bool
    ) -> None:
        with self._lock:
            size = count * len(header) + (count - 1) * slots.part_size
            self._validator.received(slots.sender, size)
            if is_answered:
                self._validator.spend(slots.sender, _ANSWER_BYTES)

    def send(self, buffers: Sequence[Buffer], to: Address) -> bool:
        """Send one datagram; return False if the address may not get so many bytes."""
        return self._may_send(to, sum(map(len, buffers))) and self._inner.send(buffers, to)

    def send_batch(self, batch: OutgoingBatch, to: Address) -> int:
        """Send parts of a message; return how many were sent."""
        return self._send_inner(batch, to) if self._may_send(to, batch.size) else 0

    def _may_send(self, to: Address, size: int) -> bool:
        if to in self._trusted:
            return True
        now_nanos = time.monotonic_ns()
        with self._lock:
            if not self._validator.is_validated(to, now_nanos):
                return self._validator.spend(to, size)
            is_due = self._validator.is_renewal_due(to, now_nanos)
        if is_due:
            self._challenge(to, now_nanos)
        return True

    def _examine(self, datagram: memoryview, sender: Address) -> None:
        """Refuse what only a validated address gets and challenge its sender."""
        now_nanos = time.monotonic_ns()
        with self._lock:
            is_validated = self._validator.is_validated(sender, now_nanos)
            if not is_validated:
                self._validator.received(sender, len(datagram))
            if not datagram or datagram[0] not in (SUBSCRIBE, CONTROL):
                return
            try:
                header, offset = parse(datagram)
                is_control = header.msg_type == CONTROL
                body = (control.parse if is_control else Subscribe.parse)(datagram[offset:])
            except Refused:
                return  # the link refuses and counts it, too
            if isinstance(body, AddressResponse):
                self._validator.respond(sender, body.cookie, now_nanos)
            if not isinstance(body, (Subscribe, Barrier)):
                return
            if is_validated:
                is_due = self._validator.is_renewal_due(sender, now_nanos)
            else:
                is_due = self._validator.spend(sender, len(_CHALLENGE_HEAD) + CHALLENGE_SIZE)
        if is_due:
            self._challenge(sender, now_nanos)
        if not is_validated:
            raise Refused("unvalidated")

    def _challenge(self, to: Address, now_nanos: int) -> None:
        challenge = AddressChallenge(self._validator.cookie(to, now_nanos))
        self._inner.send([_CHALLENGE_HEAD, challenge.pack()], to)
