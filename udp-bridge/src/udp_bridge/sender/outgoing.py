# SPDX-License-Identifier: Apache-2.0
"""What goes out next, told to whoever has the socket: a datagram, a run of parts, or an order.

Nothing is decided here: which of them goes, and when, is `sending`'s.
"""

from __future__ import annotations

from typing import List, NamedTuple, Optional

from udp_bridge.wire.fragments import Parts
from udp_bridge.wire.message import Address

from .credit_window import Flight


class Run(NamedTuple):
    """Consecutive parts of one message that may go at once."""

    parts: Parts
    first: int
    """Number of the first part."""
    parts_count: int
    size: int
    """Bytes of all datagrams."""
    behind: Optional[bytes] = None
    """A datagram that is to go right behind them."""

    @property
    def datagram_size(self) -> int:
        """Bytes of a datagram, which the message's last one may lack some of."""
        return len(self.parts.packed) + self.parts.cut.part_size


class Order(NamedTuple):
    """The rest of a message, and what has to come back before it may go."""

    parts: Parts
    to: Address
    upcoming: int
    end: int
    cost: int
    """What each part takes of the peer's receive buffer."""
    in_flight_bytes: int
    window_bytes: int
    flights: List[Flight]
    """What is in flight, the message itself last."""


class Datagram(NamedTuple):
    """What is to be sent next: `sendmsg([header, part], [], 0, to)`."""

    header: bytes
    part: memoryview
    to: Address
    is_last: bool
    """Whether its message is sent with it."""
    run: Optional[Run] = None
    """It and those that are to go with it."""
