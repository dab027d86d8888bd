# SPDX-License-Identifier: Apache-2.0
"""UDP Bridge: ROS messages as fragmented UDP datagrams, with nothing but the standard library.

Everything but `link` (the one owner of a socket) and the command line is sans-IO: bytes and
time come in as arguments. The format itself is described in PROTOCOL.md.
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
