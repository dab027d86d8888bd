# SPDX-License-Identifier: Apache-2.0
"""UDP relay with an emulated link in each direction, as `groundlink.emulation` models it.

The relay has one front socket, which senders know, and for each sender a back socket, so that
answers are returned to the right sender. Datagrams that the kernel drops are counted.
"""

import selectors
import socket
import struct
from collections import OrderedDict
from collections.abc import Callable

from groundlink.core.clock import NANOS
from groundlink.core.errors import UserError
from groundlink.emulation.model import LinkDirection
from groundlink.emulation.settings import Impairment

Address = tuple[str, int]

PEERS = 256
"""Known senders; with more, the one that was silent for the longest time is removed."""

BURST = 64
"""Datagrams read from one socket before the next one."""

RECEIVE_BUFFER = 4 << 20
LARGEST = 65_535
WAIT_SECONDS = 0.1
_SO_RXQ_OVFL = 40  # the value on Linux


class RelaySocket:
    """A socket and the sender whose datagrams it carries."""

    def __init__(self, socket_: socket.socket, peer: Address | None) -> None:
        self.socket = socket_
        self.peer = peer
        """The sender; None for the front socket."""

        self.kernel_drops = 0


class UdpRelay:
    """Relays datagrams between `listen` and `to`.

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
        """Datagrams that the kernel dropped before the link for lack of buffer space."""

        self.unsent = 0
        """Delivered datagrams that the kernel did not take, or whose sender was removed."""

        self._to = to
        self._selector = selectors.SelectSelector()  # timeouts have a resolution of microseconds
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
    def directions(self) -> dict[str, LinkDirection[Address]]:
        """Both directions, by name."""
        return {"forward": self.forward, "back": self.back}

    @property
    def peers(self) -> int:
        """Number of known senders."""
        return len(self._behind)

    def turn(self, clock: Callable[[], int]) -> None:
        """Wait for a datagram to arrive or to be due, 0.1 s at most; relay all there are."""
        for key, _ in self._selector.select(self._wait_seconds(clock())):
            self._take(key.data, clock)
        self._deliver(clock)

    def close(self) -> None:
        """Close all sockets; datagrams in the link are dropped."""
        for each in (self._front, *self._behind.values()):
            each.socket.close()
        self._selector.close()

    def _wait_seconds(self, now_nanos: int) -> float:
        dues = [due for each in (self.forward, self.back) if (due := each.next_due()) is not None]
        wait_nanos = min(dues) - now_nanos if dues else WAIT_SECONDS * NANOS
        return min(max(wait_nanos / NANOS, 0.0), WAIT_SECONDS)

    def _take(self, relay_socket: RelaySocket, clock: Callable[[], int]) -> None:
        for _ in range(BURST):
            try:
                datagram, ancillary, _, sender = relay_socket.socket.recvmsg(LARGEST, 64)
            except OSError:
                return  # no more datagrams, or the peer's host reported a closed port
            for _, kind, data in ancillary:
                if kind == _SO_RXQ_OVFL:
                    (drops,) = struct.unpack("=I", data)
                    self.kernel_drops += drops - relay_socket.kernel_drops
                    relay_socket.kernel_drops = drops
            if relay_socket.peer is None:
                self._known(sender)
                self.forward.put(datagram, sender, clock())
            else:
                self.back.put(datagram, relay_socket.peer, clock())
            self._deliver(clock)

    def _deliver(self, clock: Callable[[], int]) -> None:
        while taken := self.forward.take(clock()):
            _, datagram, peer = taken
            relay_socket = self._behind.get(peer)
            self._send(relay_socket.socket if relay_socket else None, datagram, self._to)
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
        """Open a back socket for a new sender."""
        if sender not in self._behind:
            if len(self._behind) >= PEERS:
                _, oldest = self._behind.popitem(last=False)
                self._selector.unregister(oldest.socket)
                oldest.socket.close()
            relay_socket = self._behind[sender] = RelaySocket(_bound(("0.0.0.0", 0)), sender)
            self._selector.register(relay_socket.socket, selectors.EVENT_READ, relay_socket)
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
