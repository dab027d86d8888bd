# SPDX-License-Identifier: Apache-2.0
"""Capture files: datagrams, each preceded by its length as a uint32, little-endian."""

from __future__ import annotations

from struct import Struct
from typing import BinaryIO, Iterator

from .fragments import LARGEST_DATAGRAM

_LENGTH = Struct("<I")


class BadRecording(ValueError):
    """The file is no capture; the text has the offset and the problem."""


def datagrams(file: BinaryIO) -> Iterator[bytes]:
    """Yield the datagrams of an open recording.

    Raises
    ------
    BadRecording
        Where the file ends too early, or a length is larger than any datagram.
    """
    offset = 0
    while True:
        prefix = file.read(_LENGTH.size)
        if not prefix:
            return
        if len(prefix) < _LENGTH.size:
            raise BadRecording(
                f"truncated length prefix at offset {offset}: {len(prefix)} of {_LENGTH.size} bytes"
            )
        (length,) = _LENGTH.unpack(prefix)
        if length > LARGEST_DATAGRAM:
            raise BadRecording(
                f"the length prefix at offset {offset} says {length} bytes;"
                f" a datagram has at most {LARGEST_DATAGRAM}"
            )
        offset += _LENGTH.size
        datagram = file.read(length)
        if len(datagram) < length:
            raise BadRecording(
                f"truncated datagram at offset {offset}: {len(datagram)} of {length} bytes"
            )
        offset += length
        yield datagram
