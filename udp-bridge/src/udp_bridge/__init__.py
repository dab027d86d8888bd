# SPDX-License-Identifier: Apache-2.0
"""UDP Bridge: ROS messages as fragmented UDP datagrams, with nothing but the standard library.

Everything but `link` (the one owner of a socket) and the command line is sans-IO: bytes and
time come in as arguments. The format itself is described in PROTOCOL.md.
"""

from __future__ import annotations

from .counters import Counters
from .fragments import TooLarge, fragments
from .header import BadMessage, Header, Refused, parse
from .holdings import Limits
from .link import Link
from .message import Message
from .reassembly import Reassembler
from .types import MSG_TYPES, type_number

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
