# SPDX-License-Identifier: Apache-2.0
"""RaptorQ (RFC 6330) over the parts of one message: repair symbols and recovery.

The only importer of `raptorq`, an extra, and only when it is needed. One source block, no
sub-blocks: symbol i is part i, the last one filled with zeros. The code works on byte columns, so a
body larger than the library's block is coded in stripes of columns, with the same symbols.
"""

from __future__ import annotations

import math
from functools import lru_cache
from importlib.util import find_spec
from typing import Any, Iterator, List, Mapping, Optional, Tuple

from .header import Buffer
from .repair import SYMBOL_UNIT

RAPTORQ = 1
"""The wire's number of this code."""
_BLOCK_BYTES = 10 << 20
"""Above it the library would cut a block into sub-blocks."""
_PADDING_SYMBOLS = 16
"""RFC 6330 fills up a block with at most this many symbols, at up to 255."""


@lru_cache(maxsize=None)
def is_available() -> bool:
    """Return whether the library is installed."""
    return find_spec("raptorq") is not None


def repair_count(parts_max: int, share: float) -> int:
    """Return how many repair symbols a message gets, at least one and at most 255."""
    return min(255, max(1, math.ceil(round(parts_max * share, 6))))


def repair_symbols(body: Buffer, part_size: int, count: int) -> List[memoryview]:
    """Return the repair symbols 0 .. `count` - 1 of a body.

    Parameters
    ----------
    body
        One-dimensional bytes, not empty.
    part_size
        A multiple of 8; the body is cut into parts of that size.
    count
        How many; the encoding symbol id of symbol i is parts + i.
    """
    parts = -(-len(body) // part_size)
    padded = b"".join((body, bytes(parts * part_size - len(body))))
    stripes = []
    for begin, end in _stripes(parts, part_size):
        block = padded
        if end - begin < part_size:
            starts = range(0, len(padded), part_size)
            block = b"".join([padded[start + begin : start + end] for start in starts])
        packets = _library().Encoder.with_defaults(block, end - begin).get_encoded_packets(count)
        stripes.append([memoryview(packet)[4:] for packet in packets[parts:]])
    if len(stripes) == 1:
        return stripes[0]
    return [memoryview(b"".join(stripe[number] for stripe in stripes)) for number in range(count)]


def recover(symbols: Mapping[int, Buffer], parts_max: int, part_size: int) -> Optional[bytes]:
    """Return the body with its padding, or None when the symbols do not determine it.

    Parameters
    ----------
    symbols
        Symbols of `part_size` bytes by their encoding symbol id: parts of the message below
        `parts_max`, repair symbols from there on. The last part is padded with zeros.
    """
    stripes = []
    for begin, end in _stripes(parts_max, part_size):
        decoder = _library().Decoder.with_defaults(parts_max * (end - begin), end - begin)
        for number, symbol in symbols.items():
            name = number.to_bytes(4, "big")  # source block 0, then 24 bits
            stripe: Optional[bytes] = decoder.decode(b"".join((name, symbol[begin:end])))
            if stripe is not None:
                break
        else:
            return None
        stripes.append((stripe, end - begin))
    if len(stripes) == 1:
        return stripes[0][0]
    return b"".join(
        stripe[number * width : (number + 1) * width]
        for number in range(parts_max)
        for stripe, width in stripes
    )


def _stripes(parts: int, part_size: int) -> Iterator[Tuple[int, int]]:
    """Yield the columns of each stripe; its block is small enough to stay whole."""
    widest = _BLOCK_BYTES // (parts + _PADDING_SYMBOLS) // SYMBOL_UNIT * SYMBOL_UNIT
    for begin in range(0, part_size, widest):
        yield begin, min(part_size, begin + widest)


def _library() -> Any:
    import raptorq  # type: ignore[import-untyped]

    return raptorq
