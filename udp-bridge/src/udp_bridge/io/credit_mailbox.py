# SPDX-License-Identifier: Apache-2.0
"""Credits that nobody waits for yet: kept where they come in until the sender looks.

A Credit that wakes the receiving thread costs more than one part of the message that it
acknowledges. So those for what is being sent are kept by the socket, where it can, and taken by
whoever asks for the next part. A sender that finds no room says so first and then looks once more;
from then on the next Credit wakes it. Or it leaves the rest of its message to the socket: then what
a Credit makes room for is sent where the Credit comes in. What a Credit means is `flow`'s.
"""

from __future__ import annotations

from typing import Any, Dict, List, Optional, Tuple

from udp_bridge.sender.outgoing import Order
from udp_bridge.sender.send_queue import Outbox
from udp_bridge.wire.control import Credit
from udp_bridge.wire.header import Header
from udp_bridge.wire.message import Address, DatagramKey
from udp_bridge.wire.types import CONTROL

FLIGHTS = 16
"""Messages in flight at most where the rest of one is left to the socket; as in `_runs.h`."""
Kept = Tuple[int, int, int]
"""seq_number, part_number and receive_buffer of a Credit."""
_Followed = Tuple[Address, int, str]
"""Where to, msg_type and topic."""


class Parking:
    """The credits of one topic towards one peer: those of which most was sent last.

    Parameters
    ----------
    socket
        Has `park_credits` and `parked_credits`, as `UdpSocket` has them.
    sent
        Counts what is sent, by name; what the socket sends is added.
    """

    def __init__(self, socket: Any, sent: Dict[str, int]) -> None:
        self._socket = socket
        self._sent = sent
        self._followed: Optional[_Followed] = None
        self._outbox: Optional[Outbox] = None
        self._order: Optional[Order] = None  # keeps what the socket sends from
        self._order_run: Any = getattr(socket, "order_run", None)

    def follow(self, outbox: Outbox, now_nanos: int) -> None:
        """Keep the credits for the message whose parts leave, and for others of its topic."""
        followed = (outbox.to, *outbox.large_topic)
        if followed == self._followed:
            return
        to, msg_type, topic = followed
        like = Header(CONTROL, 0, 0, 1, 0, 0, topic).pack() + Credit(msg_type, 0, 0, 0).pack()
        # What is kept until then is of the topic before.
        self._take(self._socket.park_credits(to, like), now_nanos)
        self._followed, self._outbox = followed, outbox

    def collect(self, now_nanos: int, *, waits: bool) -> bool:
        """Hand what was kept to its pacer; return whether there was anything.

        With `waits` the next Credit is not kept, but comes to the receiving thread at once.
        """
        if self._outbox is None:
            return False
        self._take_order_back(now_nanos)
        kept = self._socket.parked_credits(waits and not self._outbox.is_idle)
        if kept:
            self._take(kept, now_nanos)
        return bool(kept)

    def order(self) -> None:
        """Leave what waits for credits alone to the socket, until `collect` is called."""
        if self._outbox is None or self._order_run is None:
            return
        order = self._outbox.order()
        if order is not None and len(order.flights) <= FLIGHTS:
            self._order = order
            self._order_run(order)

    def _take_order_back(self, now_nanos: int) -> None:
        if self._order is None:
            return
        count, self._order = self._socket.order_taken_back(), None
        if count and self._outbox is not None:
            datagram = self._outbox.ordered(count, now_nanos)
            assert datagram.run is not None
            self._sent["sent_datagrams"] += count
            self._sent["sent_bytes"] += datagram.run.size
            self._sent["sent_messages"] += datagram.is_last

    def _take(self, kept: List[Kept], now_nanos: int) -> None:
        if self._followed is None or self._outbox is None:
            return
        _, msg_type, topic = self._followed
        for seq_number, part_number, receive_buffer in kept:
            key = DatagramKey(msg_type, topic, seq_number, part_number)
            self._outbox.pacer.credited(key, receive_buffer, now_nanos)


class NoParking:
    """Where the socket hands over every Credit at once."""

    def order(self) -> None:
        """Do nothing."""

    def follow(self, outbox: Outbox, now_nanos: int) -> None:
        """Do nothing."""

    def collect(self, now_nanos: int, *, waits: bool) -> bool:
        """Find nothing."""
        return False
