# SPDX-License-Identifier: Apache-2.0
"""Datagrams from one side to the other and back, through two emulated directions.

Rule: sockets and nothing else; the clock comes in as a function, what happens to datagrams is
`groundlink.emulation`. Every sender in front is a socket of its own behind, so that answers find
their way back; what the kernel drops here is counted, as it is no part of the link.
"""

from __future__ import annotations

import selectors
import socket
import struct
from collections import OrderedDict
from collections.abc import Callable

from groundlink.core.clock import NANOS
from groundlink.core.errors import UserError
from groundlink.emulation import Impairment, LinkDirection

Address = tuple[str, int]

PEERS = 256
"""Senders that are known at a time; of too many the one silent for the longest is forgotten."""

BURST = 64
"""Datagrams taken from a socket before the others have their turn."""

RECEIVE_BUFFER = 4 << 20
LARGEST = 65_535
WAIT_SECONDS = 0.1
_SO_RXQ_OVFL = 40  # the number that Linux gives it


class RelaySocket:
    """A socket, and whose datagrams it carries."""

    def __init__(self, socket_: socket.socket, peer: Address | None) -> None:
        self.socket = socket_
        self.peer = peer
        """The sender in front; None for the socket in front itself."""

        self.kernel_drops = 0


class UdpRelay:
    """A relay between `listen` and `to`.

    Raises
    ------
    UserError
        when `listen` cannot be bound.
    """

    def __init__(
        self,
        listen: Address,
        to: Address,
        *,
        forward: Impairment,
        back: Impairment,
        seed: int,
        flips: bool = False,
    ) -> None:
        self.forward: LinkDirection[Address] = LinkDirection(
            forward, seed=seed, direction="forward", flips=flips
        )
        self.back: LinkDirection[Address] = LinkDirection(
            back, seed=seed, direction="back", flips=flips
        )
        self.kernel_drops = 0
        """Datagrams that the kernel dropped in front of the link for want of buffer."""

        self.unsent = 0
        """Delivered datagrams that the kernel did not take, or whose sender is forgotten."""

        self._to = to
        self._selector = selectors.SelectSelector()  # its timeouts are as fine as microseconds
        self._behind: OrderedDict[Address, RelaySocket] = OrderedDict()
        try:
            self._front = RelaySocket(_bound(listen), None)
        except OSError as error:
            self._selector.close()
            why = (error.strerror or str(error)).lower()
            raise UserError(f"cannot listen at {listen[0]}:{listen[1]}: {why}") from None
        self._selector.register(self._front.socket, selectors.EVENT_READ, self._front)
        self.address: Address = self._front.socket.getsockname()

    @property
    def peers(self) -> int:
        """How many senders are known."""
        return len(self._behind)

    def turn(self, clock: Callable[[], int]) -> None:
        """Wait for datagrams, or until one is due, 0.1 s at most; carry what there is."""
        for key, _ in self._selector.select(self._wait_seconds(clock())):
            self._take(key.data, clock)
        self._deliver(clock)

    def close(self) -> None:
        """Give all sockets back; what is on the way is dropped."""
        for way in (self._front, *self._behind.values()):
            way.socket.close()
        self._selector.close()

    def _wait_seconds(self, now_nanos: int) -> float:
        dues = [due for way in (self.forward, self.back) if (due := way.next_due()) is not None]
        wait_nanos = min(dues) - now_nanos if dues else WAIT_SECONDS * NANOS
        return min(max(wait_nanos / NANOS, 0.0), WAIT_SECONDS)

    def _take(self, way: RelaySocket, clock: Callable[[], int]) -> None:
        for _ in range(BURST):
            try:
                datagram, ancillary, _, sender = way.socket.recvmsg(LARGEST, 64)
            except OSError:
                return  # nothing more, or an absent peer's host answered
            for _, kind, data in ancillary:
                if kind == _SO_RXQ_OVFL:
                    (drops,) = struct.unpack("=I", data)
                    self.kernel_drops += drops - way.kernel_drops
                    way.kernel_drops = drops
            if way.peer is None:
                self._known(sender)
                self.forward.put(datagram, sender, clock())
            else:
                self.back.put(datagram, way.peer, clock())
            self._deliver(clock)

    def _deliver(self, clock: Callable[[], int]) -> None:
        while taken := self.forward.take(clock()):
            _, datagram, peer = taken
            way = self._behind.get(peer)
            self._send(way.socket if way else None, datagram, self._to)
        while taken := self.back.take(clock()):
            _, datagram, peer = taken
            self._send(self._front.socket, datagram, peer)

    def _send(self, by: socket.socket | None, datagram: bytes, to: Address) -> None:
        try:
            if by is None:
                self.unsent += 1
            else:
                by.sendto(datagram, to)
        except OSError:
            self.unsent += 1

    def _known(self, sender: Address) -> None:
        """Give a new sender a socket behind the link."""
        if sender not in self._behind:
            if len(self._behind) >= PEERS:
                _, oldest = self._behind.popitem(last=False)
                self._selector.unregister(oldest.socket)
                oldest.socket.close()
            way = self._behind[sender] = RelaySocket(_bound(("0.0.0.0", 0)), sender)
            self._selector.register(way.socket, selectors.EVENT_READ, way)
        self._behind.move_to_end(sender)


def _bound(address: Address) -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        made.setsockopt(socket.SOL_SOCKET, _SO_RXQ_OVFL, 1)
        made.setblocking(False)
        made.bind(address)
    except OSError:
        made.close()
        raise
    return made
