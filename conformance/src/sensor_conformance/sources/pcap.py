# SPDX-License-Identifier: Apache-2.0
"""Captures of UDP datagrams (.pcap): a topic for each sender, port and kind of packet."""

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from .source import Received, SourceTopic, UnreadableSource

VELODYNE = "velodyne/packet"
OUSTER = "ouster/lidar_packet"
OUSTER_IMU = "ouster/imu_packet"
HESAI = "hesai/packet"
LIVOX = "livox/point_packet"
DATAGRAM = "udp/datagram"

LEGACY_LENGTHS = {3392: 16, 6464: 32, 12608: 64, 24896: 128}
"""Bytes of lidar packets of Ouster's legacy format, and rows. All have 16 columns."""

HESAI_XT = b"\xee\xff\x06\x01"
"""First bytes of packets of the PandarXT family: marks, then the version of the protocol."""

LIVOX_HEADER = 36
LIVOX_POINTS = {1: 14, 2: 8, 3: 10}
"""Bytes of a point by type of data: Cartesian in mm, Cartesian in cm, spherical."""

_ORDERS = {
    b"\xd4\xc3\xb2\xa1": ("<", 1000),
    b"\xa1\xb2\xc3\xd4": (">", 1000),
    b"\x4d\x3c\xb2\xa1": ("<", 1),
    b"\xa1\xb2\x3c\x4d": (">", 1),
}
"""Byte order, and nanoseconds of the smaller unit of times, by the first bytes of a file."""

_LINK_BYTES = {0: 4, 1: 14, 101: 0, 113: 16, 228: 0, 276: 20}
"""Length of the link header: loopback, Ethernet, raw IP, Linux cooked captures."""


@dataclass(frozen=True)
class CapturedDatagram:
    """A UDP datagram. Its attributes are those that readings of packets take."""

    data: bytes


@dataclass
class _Fragments:
    """Parts of an IP packet by their offsets."""

    parts: dict[int, bytes] = field(default_factory=dict)
    length: int = 0

    def whole(self) -> bytes | None:
        """Return the payload if all parts have arrived."""
        joined = b"".join(self.parts[start] for start in sorted(self.parts))
        return joined if self.length and len(joined) == self.length else None


class PcapSource:
    """A capture file in the classic format of libpcap.

    Parameters
    ----------
    path
        The file. All datagrams are kept in memory.

    Raises
    ------
    UnreadableSource
        If the file is missing or no such capture.
    """

    def __init__(self, path: Path) -> None:
        self.name = path.name
        try:
            content = path.read_bytes()
        except OSError as error:
            raise UnreadableSource(f"{path}: {error.strerror}") from error
        if content[:4] not in _ORDERS or len(content) < 24:
            raise UnreadableSource(f"{path}: no capture of libpcap")
        streams: dict[tuple[str, int], list[Received]] = {}
        for time, sender, port, data in _datagrams(content):
            streams.setdefault((sender, port), []).append(Received(time, CapturedDatagram(data)))
        self._messages: dict[SourceTopic, list[Received]] = {}
        for (sender, port), all_of in sorted(streams.items()):
            for kind, some in _by_kind(all_of).items():
                self._messages[SourceTopic(f"{sender}/{port}/{kind}", kind)] = some

    def topics(self) -> Sequence[SourceTopic]:
        """Return a topic for each sender, port and kind of datagram."""
        return tuple(self._messages)

    def messages(self, topic: str) -> Iterator[Received]:
        """Yield the datagrams of a topic."""
        for known, messages in self._messages.items():
            if known.name == topic:
                yield from messages


def kind_of(data: bytes) -> str:
    """Return which device's packet a datagram is, by its length and marks."""
    if len(data) == 1206 and data[:2] == b"\xff\xee":
        return VELODYNE
    if len(data) == 48:
        return OUSTER_IMU
    if len(data) in LEGACY_LENGTHS:
        return OUSTER
    if len(data) > 3000 and data[:1] == b"\x01" and (len(data) - 64) % 16 == 0:
        return OUSTER
    if data[:4] == HESAI_XT and len(data) == hesai_length(data):
        return HESAI
    if _is_livox(data):
        return LIVOX
    return DATAGRAM


def hesai_length(data: bytes) -> int:
    """Return how long a packet of a PandarXT is by its header; lasers and blocks stand there."""
    if len(data) < 12:
        return 0
    lasers, blocks, has_sequence = data[6], data[7], data[11] & 1
    return 12 + blocks * (2 + 4 * lasers) + 24 + 4 * has_sequence


def _is_livox(data: bytes) -> bool:
    """Say whether a datagram has points of a Livox LiDAR of SDK 2; those of its IMU have none."""
    if len(data) <= LIVOX_HEADER or data[0] or data[10] not in LIVOX_POINTS:
        return False
    length: int
    points: int
    length, points = struct.unpack_from("<HxxH", data, 1)
    expected = LIVOX_HEADER + points * LIVOX_POINTS[data[10]]
    return len(data) == length == expected


def _by_kind(messages: list[Received]) -> dict[str, list[Received]]:
    """Return the datagrams of a stream by kind; unknown ones are faulty ones of the known."""
    kinds = [kind_of(one.message.data) for one in messages]
    known = [kind for kind in dict.fromkeys(kinds) if kind != DATAGRAM]
    fallback = known[0] if len(known) == 1 else DATAGRAM
    found: dict[str, list[Received]] = {}
    for kind, one in zip(kinds, messages, strict=True):
        found.setdefault(fallback if kind == DATAGRAM else kind, []).append(one)
    return found


def _datagrams(content: bytes) -> Iterator[tuple[int, str, int, bytes]]:
    """Yield time in ns, sender, port of destination and data of each whole UDP datagram."""
    order, unit = _ORDERS[content[:4]]
    (link,) = struct.unpack_from(order + "I", content, 20)
    skip = _LINK_BYTES.get(link & 0xFFFF)
    if skip is None:
        raise UnreadableSource(f"link type {link & 0xFFFF} is not known")
    waiting: dict[tuple[bytes, int], _Fragments] = {}
    at = 24
    while at + 16 <= len(content):
        seconds, fraction, length, _ = struct.unpack_from(order + "4I", content, at)
        packet = content[at + 16 + skip : at + 16 + length]
        at += 16 + length
        if len(packet) < 20 or packet[0] >> 4 != 4 or packet[9] != 17:
            continue
        header = (packet[0] & 15) * 4
        total, identity, flags = struct.unpack_from(">HHH", packet, 2)
        payload: bytes | None = packet[header:total]
        assert payload is not None
        start, is_more = (flags & 0x1FFF) * 8, bool(flags & 0x2000)
        if start or is_more:
            fragments = waiting.setdefault((packet[12:20], identity), _Fragments())
            fragments.parts[start] = payload
            if not is_more:
                fragments.length = start + len(payload)
            payload = fragments.whole()
            if payload is None:
                continue
            del waiting[packet[12:20], identity]
        if len(payload) >= 8:
            port, size = struct.unpack_from(">HH", payload, 2)
            sender = ".".join(str(part) for part in packet[12:16])
            yield seconds * 10**9 + fraction * unit, sender, port, payload[8:size]
