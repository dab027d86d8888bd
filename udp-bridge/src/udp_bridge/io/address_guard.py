# SPDX-License-Identifier: Apache-2.0
"""Opens a link's socket behind the guard that its user asked for: a peer, a key, or neither.

A socket that other hosts can reach, without a peer and without a key, validates addresses: it takes
data from any address, but neither Subscribe nor Barrier before the address is validated, and it
sends an unvalidated address no more bytes than came from there.
"""

from __future__ import annotations

import os
import threading
import time
from typing import List, Optional, Sequence, Tuple

from udp_bridge.receiver.receive_slots import NO_SLOTS, CreditState, PartBatch, ReceiveSlots
from udp_bridge.sender.outgoing import Run as Leaving
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

from .socket_wrappers import Around, PeersOnly, Sealed
from .udp_socket import ENOUGH_BUFFER, DatagramSocket, UdpSocket, resolve

_WAIT_S = 0.1
_KEY_SIZE = 32
_CHALLENGE_HEAD = Header(CONTROL, 0, 0, 1, 0, 0).pack()
_ANSWERS_OF_A_RUN = 4096
"""More than the Credits and the Request take that a socket sends while it receives one run."""


class Unguarded(ValueError):
    """Other hosts can reach a socket that has neither a peer nor a key; the text is one line."""


def open_socket(
    bind: Address,
    *,
    peer: Optional[Address] = None,
    secret: Optional[bytes] = None,
    sends: int,
    allow_any_peer: bool = False,
    receive_buffer: int = ENOUGH_BUFFER,
) -> DatagramSocket:
    """Return a bound socket behind its guard.

    Parameters
    ----------
    peer
        The only sender whose datagrams are taken; port 0 stands for every port of the host.
    secret
        The key that both ends share; see `Sealed`.
    sends
        `seal.TO_ROS` or `seal.FROM_ROS`.
    allow_any_peer
        Accept that other hosts can reach the socket although there is neither peer nor secret.

    Raises
    ------
    Unguarded
        When other hosts can reach the socket, and nothing says who may send to it.
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
        around = PeersOnly(bare, [allowed]) if allowed is not None else bare
        return Sealed(around, secret, sends=sends)
    return guarded(bare, allowed)


def guarded(bare: UdpSocket, peer: Optional[Address]) -> DatagramSocket:
    """Return a bound socket behind the guard that it needs; `peer` is numeric."""
    if peer is not None:
        return PeersOnly(bare, [peer])
    return bare if is_local(bare.address) else AddressGuard(bare)


class AddressGuard(Around):
    """Validates addresses, and limits what is sent to others; see `address_validation`."""

    def __init__(self, inner: UdpSocket) -> None:
        super().__init__(inner)
        self._validator = AddressValidator(os.urandom(_KEY_SIZE))
        self._vouched: List[Address] = []
        self._lock = threading.Lock()  # one thread receives while another one sends
        self._inner_run, self._inner_send_run = inner.receive_run, inner.send_run
        for name in ("park_credits", "parked_credits", "order_run", "order_taken_back"):
            if hasattr(inner, name):
                setattr(self, name, getattr(inner, name))

    def vouch(self, address: Address) -> None:
        """Send to an address without asking it: the user named it."""
        self._vouched = [*self._vouched, address]

    def is_known(self, address: Address) -> bool:
        """Return whether an address is validated, or was named by the user."""
        if address in self._vouched:
            return True
        with self._lock:
            return self._validator.is_validated(address, time.monotonic_ns())

    def receive_into(self, buffer: bytearray) -> Optional[Tuple[int, Address]]:
        """Wait for a datagram; return its size and sender, or None when there was none.

        Raises
        ------
        Refused
            When it asks for what only a validated address gets.
        """
        received = self._inner.receive_into(buffer)
        if received is not None:
            self._examine(memoryview(buffer)[: received[0]], received[1])
        return received

    def receive_run(self, place: ReceiveSlots, credits: CreditState) -> Optional[PartBatch]:
        """Do as `UdpSocket.receive_run`, where the sender may be sent what parts are answered."""
        is_limited = bool(place.arrived) and not self.is_known(place.sender)
        if is_limited and self._validator.unsent(place.sender) < _ANSWERS_OF_A_RUN:
            place, credits = NO_SLOTS, CreditState(0, self.receive_buffer, 0)
        run = self._inner_run(place, credits)
        if run is None:
            return None
        if run.part_ranges and is_limited:
            with self._lock:
                size = run.parts_count * len(run.header) + (run.parts_count - 1) * place.part_size
                self._validator.received(place.sender, size)
                if run.credits_sent or run.nack_bitmap:
                    self._validator.spend(place.sender, _ANSWERS_OF_A_RUN)
        if run.unmatched is not None and run.unmatched_sender is not None:
            try:
                self._examine(memoryview(run.unmatched), run.unmatched_sender)
            except Refused as refused:
                return run._replace(unmatched=None, unmatched_sender=None, refused=refused.reason)
        return run

    def send(self, buffers: Sequence[Buffer], to: Address) -> bool:
        """Send one datagram; return False where the address may not be sent so much."""
        return self._may_send(to, sum(map(len, buffers))) and self._inner.send(buffers, to)

    def send_run(self, run: Leaving, to: Address) -> int:
        """Send parts of a message; return how many were sent."""
        return self._inner_send_run(run, to) if self._may_send(to, run.size) else 0

    def _may_send(self, to: Address, size: int) -> bool:
        if to in self._vouched:
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
        """Refuse what only a validated address gets, and challenge its sender."""
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
                said = (control.parse if is_control else Subscribe.parse)(datagram[offset:])
            except Refused:
                return  # the link refuses it, too, and counts why
            if isinstance(said, AddressResponse):
                self._validator.respond(sender, said.cookie, now_nanos)
            if not isinstance(said, (Subscribe, Barrier)):
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
