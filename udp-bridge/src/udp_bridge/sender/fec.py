# SPDX-License-Identifier: Apache-2.0
"""The Repair datagrams that follow a message in the mode `fec`. What a symbol is, is `fec`'s."""

from __future__ import annotations

from udp_bridge.wire import fec
from udp_bridge.wire.fragments import Parts, Split, flat
from udp_bridge.wire.message import Message
from udp_bridge.wire.repair import SYMBOL_UNIT, Symbol
from udp_bridge.wire.types import REPAIR

from .repair import Fec


def symbols_of(message: Message, cut: Split, mode: Fec) -> Parts:
    """Return the repair datagrams of a numbered message; none of an empty one.

    They are computed here, which takes about 1 ms per megabyte. To whoever sends them they are the
    parts of one body, whose header includes what stands before each symbol.
    """
    body = flat(message.body)
    if not body.nbytes:
        return Parts(b"", body, Split(1, 0))
    size = cut.part_size
    if cut.parts_max == 1:
        size = -(-body.nbytes // SYMBOL_UNIT) * SYMBOL_UNIT
    count = fec.repair_count(cut.parts_max, mode.share)
    named = message._replace(msg_type=REPAIR).header(parts_max=count).pack()
    prefix = Symbol(message.msg_type, cut.parts_max, fec.RAPTORQ, body.nbytes).pack()
    symbols = memoryview(b"".join(fec.repair_symbols(body, size, count)))
    return Parts(named + prefix, symbols, Split(size, count))
