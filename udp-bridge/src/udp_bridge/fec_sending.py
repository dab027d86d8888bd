# SPDX-License-Identifier: Apache-2.0
"""The Repair datagrams that follow a message in the mode `fec`. What a symbol is, is `fec`'s."""

from __future__ import annotations

from typing import Iterator, Tuple

from . import fec
from .fragments import Split, flat
from .header import PART_NUMBER_OFFSET
from .message import Message
from .repair import Fec
from .repair_wire import SYMBOL_UNIT, Symbol
from .types import REPAIR


def symbols_of(message: Message, cut: Split, mode: Fec) -> Iterator[Tuple[bytes, memoryview]]:
    """Yield the repair datagrams of a numbered message, header and body; none of an empty one.

    They are computed when the first is taken, which costs about 1 ms a megabyte.
    """
    body = flat(message.body)
    if not body.nbytes:
        return
    size = cut.part_size
    if cut.parts_max == 1:
        size = -(-body.nbytes // SYMBOL_UNIT) * SYMBOL_UNIT
    count = fec.repair_count(cut.parts_max, mode.share)
    named = message._replace(msg_type=REPAIR).header(parts_max=count).pack()
    prefix = Symbol(message.msg_type, cut.parts_max, fec.RAPTORQ, body.nbytes).pack()
    for number, symbol in enumerate(fec.repair_symbols(body, size, count)):
        header = named[:PART_NUMBER_OFFSET] + bytes((number,)) + named[PART_NUMBER_OFFSET + 1 :]
        yield header + prefix, symbol
