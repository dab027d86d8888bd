# SPDX-License-Identifier: Apache-2.0
"""Repair symbols of a message that is being put together, and how they fill its gaps.

Bounded: no more symbols are kept than a message has parts, and each failed attempt to decode costs
one of a few. The code itself is `fec`'s.
"""

from __future__ import annotations

from typing import Dict

from udp_bridge.wire import fec
from udp_bridge.wire.header import Buffer, Refused
from udp_bridge.wire.repair import Symbol

from .assembly import Assembly

ATTEMPTS = 8
"""Decoding fails once in 256 times with as many symbols as parts, and with each symbol more 256
times less often."""


class Symbols:
    """The repair symbols of one message."""

    __slots__ = ("attempts", "body_size", "by_number", "symbol_size")

    def __init__(self, body_size: int, symbol_size: int) -> None:
        self.body_size = body_size
        self.symbol_size = symbol_size
        self.by_number: Dict[int, bytes] = {}
        """Symbols by their index among those that were sent."""
        self.attempts = 0

    @property
    def bytes_held(self) -> int:
        """What the symbols take."""
        return len(self.by_number) * self.symbol_size


def check(assembly: Assembly, symbol: Symbol, data: Buffer) -> None:
    """Raise `Refused` when a symbol contradicts what is known of its message."""
    if symbol.parts_max != assembly.header.parts_max:
        raise Refused("parts_max")
    symbols = assembly.symbols
    if symbols is None:
        assembly.expect(len(data))
    elif symbols.body_size != symbol.body_size or symbols.symbol_size != len(data):
        raise Refused("part_size")


def add(assembly: Assembly, number: int, symbol: Symbol, data: Buffer) -> bool:
    """Keep a symbol of a message that `check` lets pass; return whether it is new."""
    symbols = assembly.symbols
    if symbols is None:
        assembly.expect(len(data))
        symbols = assembly.symbols = Symbols(symbol.body_size, len(data))
    if number in symbols.by_number:
        return False
    if len(symbols.by_number) < symbol.parts_max:
        symbols.by_number[number] = bytes(data)
    return True


def mend(assembly: Assembly) -> bool:
    """Fill the gaps of a message, if its symbols suffice; return whether it is complete now."""
    symbols = assembly.symbols
    parts_max = assembly.header.parts_max
    if symbols is None or symbols.attempts >= ATTEMPTS:
        return False
    if assembly.parts_in + len(symbols.by_number) < parts_max:
        return False
    size = symbols.symbol_size
    known: Dict[int, Buffer] = {}
    missing = []
    for number in range(parts_max):
        if assembly.has(number):
            # A copy: as long as it is looked at, the buffer of the parts can't grow.
            known[number] = bytes(assembly.part(number)).ljust(size, b"\0")
        else:
            missing.append(number)
    known.update({parts_max + number: data for number, data in symbols.by_number.items()})
    body = fec.recover(known, parts_max, size)
    if body is None:
        symbols.attempts += 1
        return False
    view = memoryview(body)[: symbols.body_size]
    for number in missing:
        part = view[number * size : (number + 1) * size]
        assembly.add(assembly.header._replace(part_number=number), part)
    return assembly.complete
