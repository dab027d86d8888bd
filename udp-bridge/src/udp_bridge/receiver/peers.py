# SPDX-License-Identifier: Apache-2.0
"""Peers: the addresses that datagrams come from, with their goodput and what they are owed.

Bounded: the peer that was silent for the longest is forgotten. `limits` holds their messages.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from typing import Iterator, Optional, Tuple, Union

from udp_bridge.wire.control import Credit, LinkReport, TopicReport
from udp_bridge.wire.header import NANOS, Header
from udp_bridge.wire.message import Address
from udp_bridge.wire.numbering import Numbering
from udp_bridge.wire.types import CONTROL

GOODPUT_GRAIN_NANOS = NANOS // 10
"""Resolution of the window of one second over which goodput is measured."""


class Peer:
    """One address that sends to this receiver."""

    def __init__(self, now_nanos: int) -> None:
        self.numbering = Numbering()
        """Numbers of the Control messages to this peer."""
        self.uncredited_bytes = 0
        self.last_heard_nanos = now_nanos
        self.goodput_bytes = 0
        """Bytes received from this peer."""
        self.last_goodput = 0
        """Goodput when it was last computed, for requests that the socket sends."""
        self._marks = deque([(now_nanos, 0)])  # times, and bytes received until then

    def goodput(self, now_nanos: int) -> int:
        """Return the bytes received within the last second, or per second over a longer time."""
        if now_nanos - self._marks[-1][0] >= GOODPUT_GRAIN_NANOS:
            self._marks.append((now_nanos, self.goodput_bytes))
        while len(self._marks) > 1 and now_nanos - self._marks[1][0] >= NANOS:
            self._marks.popleft()
        since_nanos, bytes_before = self._marks[0]
        received = self.goodput_bytes - bytes_before
        return min(received * NANOS // max(NANOS, now_nanos - since_nanos), 0xFFFFFFFF)

    def pack_control(
        self, topic: str, link: str, stamp_nanos: int, body: Union[Credit, TopicReport, LinkReport]
    ) -> bytes:
        """Return the datagram of the next Control message to this peer."""
        number = self.numbering.next(CONTROL, topic)
        sec, nsec = divmod(stamp_nanos, NANOS)
        return Header(CONTROL, number, 0, 1, sec, nsec, topic, link).pack() + body.pack()


class PeerTable:
    """The peers that sent most recently."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._peers: OrderedDict[Address, Peer] = OrderedDict()

    def __iter__(self) -> Iterator[Tuple[Address, Peer]]:
        return iter(self._peers.items())

    def get(self, address: Address) -> Optional[Peer]:
        """Return the peer at an address, or None."""
        return self._peers.get(address)

    def record(self, address: Address, now_nanos: int) -> Peer:
        """Record a datagram from an address; return its peer."""
        peer = self._peers.get(address)
        if peer is None:
            if len(self._peers) >= self._limit:
                self._peers.popitem(last=False)
            peer = self._peers[address] = Peer(now_nanos)
        self._peers.move_to_end(address)
        peer.last_heard_nanos = now_nanos
        return peer
