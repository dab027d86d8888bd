# SPDX-License-Identifier: Apache-2.0
"""Credits that nobody waits for yet: kept where they come in until the sender looks.

A Credit that wakes the receiving thread costs more than one part of the message that it
acknowledges. So those for what is being sent are kept by the socket, where it can, and taken by
whoever asks for the next part. A sender that finds no room says so first and then looks once more;
from then on the next Credit wakes it. What a Credit means is `flow`'s.
"""

from __future__ import annotations

from typing import Any, List, Optional, Tuple

from .control import Credit
from .flow import DatagramKey
from .header import Header
from .sending import Address, Outbox
from .types import CONTROL

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
    """

    def __init__(self, socket: Any) -> None:
        self._socket = socket
        self._followed: Optional[_Followed] = None
        self._outbox: Optional[Outbox] = None

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
        kept = self._socket.parked_credits(waits and not self._outbox.is_idle)
        if kept:
            self._take(kept, now_nanos)
        return bool(kept)

    def _take(self, kept: List[Kept], now_nanos: int) -> None:
        if self._followed is None or self._outbox is None:
            return
        _, msg_type, topic = self._followed
        for seq_number, part_number, receive_buffer in kept:
            key = DatagramKey(msg_type, topic, seq_number, part_number)
            self._outbox.pacer.acknowledged(key, receive_buffer, now_nanos)


class NoParking:
    """Where the socket hands over every Credit at once."""

    def follow(self, outbox: Outbox, now_nanos: int) -> None:
        """Do nothing."""

    def collect(self, now_nanos: int, *, waits: bool) -> bool:
        """Find nothing."""
        return False
