# SPDX-License-Identifier: Apache-2.0
"""Functions of a socket that send a message with its number and stamp by one call."""

from __future__ import annotations

from typing import Callable, NamedTuple, Optional

from udp_bridge.wire.header import Buffer
from udp_bridge.wire.message import Address

SendSmall = Callable[[Address, bytes, int, int, int, Buffer], int]
"""Sends a message of one part at once, or not at all: destination, header of part 0, most bytes of
the body, seq_number, stamp, body. Returns the bytes of the body, or -1."""
SendLarge = Callable[[Address, bytes, int, int, int, int, int, Buffer], int]
"""Sends a message of several parts: destination, header of part 0, bytes of the body, part size,
number of parts, seq_number, stamp, body. Returns how many parts the kernel took, or -1 if the body
has another size."""


class DirectSenders(NamedTuple):
    """Functions of a socket that send whole messages, where it has them."""

    small: Optional[SendSmall] = None
    large: Optional[SendLarge] = None

    @classmethod
    def of(cls, socket: object) -> DirectSenders:
        """Return those of a socket."""
        return cls(getattr(socket, "send_small", None), getattr(socket, "send_large", None))
