# SPDX-License-Identifier: Apache-2.0
"""Captures of UDP datagrams as files that Wireshark reads: pcap of raw IPv4 packets."""

import socket
import struct
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from udp_bridge.wire.message import Address

_FILE = struct.Struct("<IHHiIII")
_RECORD = struct.Struct("<IIII")
_IP = struct.Struct("!BBHHHBBH4s4s")
_UDP = struct.Struct("!HHHH")
_MAGIC = 0xA1B23C4D
"""Magic number of a file with times in nanoseconds."""
_RAW_IP = 101
_UDP_NUMBER = 17


class Packet(NamedTuple):
    """A datagram with its addresses."""

    source: Address
    to: Address
    datagram: bytes


def write(path: Path, packets: Iterable[Packet]) -> None:
    """Write packets, a microsecond apart; checksums are left out, as IPv4 allows for UDP."""
    with open(path, "wb") as file:
        file.write(_FILE.pack(_MAGIC, 2, 4, 0, 0, 1 << 18, _RAW_IP))
        for index, packet in enumerate(packets):
            data = _ip(packet)
            file.write(_RECORD.pack(0, 1000 * index, len(data), len(data)) + data)


def _ip(packet: Packet) -> bytes:
    size = _UDP.size + len(packet.datagram)
    addresses = socket.inet_aton(packet.source[0]), socket.inet_aton(packet.to[0])
    return (
        _IP.pack(0x45, 0, _IP.size + size, 0, 0, 64, _UDP_NUMBER, 0, *addresses)
        + _UDP.pack(packet.source[1], packet.to[1], size, 0)
        + packet.datagram
    )
