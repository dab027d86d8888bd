# SPDX-License-Identifier: Apache-2.0
"""UDP Bridge: ROS messages as fragmented UDP datagrams, with nothing but the standard library.

`Link` is one end of a bridge. `wire`, `sender` and `receiver` do no I/O: bytes and time are
arguments. PROTOCOL.md describes the wire format.
"""

from __future__ import annotations

from udp_bridge.io.link import Link
from udp_bridge.receiver.delivery_log import Counters
from udp_bridge.receiver.limits import Limits
from udp_bridge.receiver.reassembly import Reassembler
from udp_bridge.wire.fragments import TooLarge, fragments
from udp_bridge.wire.header import BadMessage, Header, Refused, parse
from udp_bridge.wire.message import Message
from udp_bridge.wire.types import MSG_TYPES, type_number

__all__ = [
    "MSG_TYPES",
    "BadMessage",
    "Counters",
    "Header",
    "Limits",
    "Link",
    "Message",
    "Reassembler",
    "Refused",
    "TooLarge",
    "fragments",
    "parse",
    "type_number",
]
