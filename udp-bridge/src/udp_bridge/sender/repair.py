# SPDX-License-Identifier: Apache-2.0
"""Repair modes: how lost datagrams of a topic are recovered, as the sender configures it.

`Resend` sends requested datagrams again; `Fec` sends repair symbols with every message. A topic
that is not in the table is not repaired.
"""

from __future__ import annotations

import math
from typing import Dict, Mapping, NamedTuple, Optional, Union

from udp_bridge.wire import fec
from udp_bridge.wire.fragments import Parts, Split, flat
from udp_bridge.wire.header import NANOS, BadMessage
from udp_bridge.wire.message import Message, TopicKey
from udp_bridge.wire.repair import SYMBOL_UNIT, Symbol
from udp_bridge.wire.types import REPAIR

DEFAULT_LIMIT_S = 0.5
"""Three times six round trips of 20 ms with their waiting times."""
LONGEST_LIMIT_S = 60.0


class Fec(NamedTuple):
    """Forward error correction: repair symbols are sent with every message."""

    share: float
    """Repair symbols per part of the message, in (0, 1]; the count is rounded up."""


class Resend(NamedTuple):
    """Retransmission: the receiver requests lost datagrams and the sender sends them again."""

    limit_nanos: int
    """Age at which a message is stale and no longer requested or resent."""


Mode = Union[Fec, Resend]
RepairTable = Mapping[TopicKey, Mode]


def parse_mode(mode: object) -> Optional[Mode]:
    """Return a repair mode from its form in a scenario or on the command line.

    Parameters
    ----------
    mode
        `"none"`, `"resend"`, `{"resend": limit in seconds}` or `{"fec": share}`.

    Raises
    ------
    BadMessage
        When it is none of these.
    """
    if mode is None or mode == "none":
        return None
    if mode == "resend":
        return Resend(int(DEFAULT_LIMIT_S * NANOS))
    if isinstance(mode, dict) and len(mode) == 1:
        ((name, value),) = mode.items()
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            if name == "fec" and 0 < value <= 1:
                return Fec(float(value))
            if name == "resend" and 0.001 <= value <= LONGEST_LIMIT_S:
                return Resend(math.ceil(value * NANOS))
    raise BadMessage(
        f"repair {mode!r} is neither none, resend, {{resend: seconds up to"
        f" {LONGEST_LIMIT_S:.0f}}} nor {{fec: share above 0 and up to 1}}"
    )


def check_table(table: Optional[RepairTable]) -> RepairTable:
    """Return a copy of a table whose modes are available on this host.

    Raises
    ------
    BadMessage
        When it contains `Fec` and the package raptorq is not installed.
    """
    copy: Dict[TopicKey, Mode] = dict(table or {})
    if not fec.is_available():
        for (_, topic), mode in copy.items():
            if isinstance(mode, Fec):
                raise BadMessage(
                    f"repair of {topic!r} by fec needs the package raptorq:"
                    " install udp-bridge[fec], or choose resend or none"
                )
    return copy


def repair_parts(message: Message, cut: Split, mode: Fec) -> Parts:
    """Return the Repair datagrams of a numbered message; none if its body is empty.

    Computing the symbols takes about 1 ms per megabyte. The result looks like the parts of one
    body whose header includes the prefix of each symbol.
    """
    body = flat(message.body)
    if not body.nbytes:
        return Parts(b"", body, Split(1, 0))
    size = cut.part_size
    if cut.parts_max == 1:
        size = -(-body.nbytes // SYMBOL_UNIT) * SYMBOL_UNIT
    count = fec.repair_count(cut.parts_max, mode.share)
    header = message._replace(msg_type=REPAIR).header(parts_max=count).pack()
    prefix = Symbol(message.msg_type, cut.parts_max, fec.RAPTORQ, body.nbytes).pack()
    symbols = memoryview(b"".join(fec.repair_symbols(body, size, count)))
    return Parts(header + prefix, symbols, Split(size, count))
