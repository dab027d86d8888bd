# SPDX-License-Identifier: Apache-2.0
"""What a receiver knows of those who send to it: when they were heard, how much came, what is due.

Bounded: of too many the one silent for the longest gives way. Their messages are in `holdings`.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from typing import Iterator, Optional, Tuple

from udp_bridge.wire.header import NANOS
from udp_bridge.wire.message import Address
from udp_bridge.wire.numbering import Numbering

GOODPUT_GRAIN_NANOS = NANOS // 10
"""Of the measure of what comes within a second."""


class Peer:
    """One sender."""

    def __init__(self, now_nanos: int) -> None:
        self.numbering = Numbering()
        """Of what is answered."""
        self.uncredited_bytes = 0
        self.heard_nanos = now_nanos
        self.goodput_bytes = 0
        """All that came from it."""
        self.goodput_told = 0
        """The last word on that, for those who have no time to reckon."""
        self._marks = deque([(now_nanos, 0)])  # when, and what came until then

    def goodput(self, now_nanos: int) -> int:
        """Return the bytes that came within the last second, or in one on the average."""
        if now_nanos - self._marks[-1][0] >= GOODPUT_GRAIN_NANOS:
            self._marks.append((now_nanos, self.goodput_bytes))
        while len(self._marks) > 1 and now_nanos - self._marks[1][0] >= NANOS:
            self._marks.popleft()
        since_nanos, until_then = self._marks[0]
        came = self.goodput_bytes - until_then
        return min(came * NANOS // max(NANOS, now_nanos - since_nanos), 0xFFFFFFFF)


class Peers:
    """The senders that were heard last."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._peers: OrderedDict[Address, Peer] = OrderedDict()

    def __len__(self) -> int:
        return len(self._peers)

    def __iter__(self) -> Iterator[Tuple[Address, Peer]]:
        return iter(self._peers.items())

    def get(self, sender: Address) -> Optional[Peer]:
        """Return what is known of a sender, if anything is."""
        return self._peers.get(sender)

    def heard(self, sender: Address, now_nanos: int) -> Peer:
        """Take note that something came from a sender; return what is known of it."""
        peer = self._peers.get(sender)
        if peer is None:
            if len(self._peers) >= self._most:
                self._peers.popitem(last=False)
            peer = self._peers[sender] = Peer(now_nanos)
        self._peers.move_to_end(sender)
        peer.heard_nanos = now_nanos
        return peer
