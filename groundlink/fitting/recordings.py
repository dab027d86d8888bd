# SPDX-License-Identifier: Apache-2.0
"""Firings out of recordings: bags, MCAP files, captures of packets, and Ouster's own files.

A bag or an MCAP file may hold sensor_msgs/PointCloud2 with `ring` and `intensity`, or packets as
the drivers of Velodyne and Hesai record them (velodyne_msgs/VelodyneScan, pandar_msgs/PandarScan).
"""

import sqlite3
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mcap.exceptions import McapError
from mcap.reader import make_reader

from groundlink.core.errors import RequirementError, UserError
from groundlink.data.ros_arrays import content
from groundlink.ros.types import STORE

from .firings import Firings, joined, of_cloud
from .packets import of_packets

CLOUD = "sensor_msgs/msg/PointCloud2"
PACKETS = {
    "velodyne_msgs/msg/VelodyneScan": (1206, 0),
    "pandar_msgs/msg/PandarScan": (1500, 4),
}
"""Types of messages of packets: bytes that a packet has room for, and bytes of its size after."""

_PCAP = {0xA1B2C3D4: "<", 0xA1B23C4D: "<", 0xD4C3B2A1: ">", 0x4D3CB2A1: ">"}


class _Message(NamedTuple):
    """A message of a bag."""

    topic: str
    ros_type: str
    cdr: bytes


def read_firings(path: Path, topic: str | None = None) -> Firings:
    """Return the firings of a recording.

    Parameters
    ----------
    path : Path
        A bag (`.db3` or its folder), an MCAP file, a capture (`.pcap`) of a Velodyne or a Hesai, or
        of an Ouster with its metadata beside it, or an `.osf` file.
    topic : str or None
        Needed where a bag has several topics of clouds or packets.

    Raises
    ------
    UserError
        when there are none, or nothing says which.
    """
    if path.is_dir():
        found = sorted([*path.glob("*.db3"), *path.glob("*.mcap")])
        if not found:
            raise UserError(f"{path}: a folder without a .db3 or .mcap file; expected a ROS 2 bag")
        path = found[0]
    if not path.exists():
        raise UserError(f"{path}: no such file")
    try:
        match path.suffix:
            case ".osf":
                return _ouster(path)
            case ".pcap":
                packets = list(_captured(path))
                try:
                    return of_packets(packets, str(path))
                except UserError:
                    return _ouster(path)
            case ".db3":
                return _of_messages(path, _bag(path), topic)
            case ".mcap":
                return _of_messages(path, _mcap(path), topic)
    except (sqlite3.Error, McapError, struct.error) as error:
        raise UserError(f"{path}: cannot be read: {error}") from None
    raise UserError(f"{path}: expected a .db3, .mcap, .pcap or .osf file, or the folder of a bag")


def _of_messages(path: Path, messages: Iterator[_Message], topic: str | None) -> Firings:
    known = [
        message
        for message in messages
        if message.ros_type in (CLOUD, *PACKETS) and topic in (None, message.topic)
    ]
    topics = sorted({message.topic for message in known})
    if len(topics) != 1:
        raise UserError(
            f"{path}: {len(topics)} topics of clouds or packets: {', '.join(topics) or 'none'}; "
            "expected one. Fix: name it with --topic"
        )
    if known[0].ros_type == CLOUD:
        clouds = (content(STORE.deserialize_cdr(message.cdr, CLOUD)) for message in known)
        return joined(of_cloud(_checked(path, cloud)) for cloud in clouds)
    packets = [packet for message in known for packet in _packets(message)]
    return of_packets(packets, f"{path}: {topics[0]}")


def _checked(path: Path, cloud: object) -> "np.ndarray[tuple[int, ...], np.dtype[np.void]]":
    """Return the points of a cloud."""
    assert isinstance(cloud, np.ndarray)
    names = cloud.dtype.names or ()
    if missing := {"x", "y", "z", "ring", "intensity"} - set(names):
        raise UserError(
            f"{path}: clouds have the fields {', '.join(names)}; expected also "
            f"{', '.join(sorted(missing))}"
        )
    return cloud


def _packets(message: _Message) -> Iterator[bytes]:
    """Yield the packets in a scan: a header, then a list of stamp, data and perhaps size."""
    size, after = PACKETS[message.ros_type]
    cdr = memoryview(message.cdr)[4:]
    (frame,) = struct.unpack_from("<I", cdr, 8)
    at = -(-(12 + frame) // 4) * 4
    (count,) = struct.unpack_from("<I", cdr, at)
    stride = -(-(8 + size + after) // 4) * 4
    for number in range(count):
        first = at + 4 + number * stride + 8
        used = size
        if after:
            (used,) = struct.unpack_from("<I", cdr, first + size)
        yield bytes(cdr[first : first + min(used, size)])


def _bag(path: Path) -> Iterator[_Message]:
    with sqlite3.connect(f"file:{path}?mode=ro", uri=True) as bag:
        yield from map(
            _Message._make,
            bag.execute(
                "SELECT topics.name, topics.type, messages.data FROM messages "
                "JOIN topics ON messages.topic_id = topics.id ORDER BY messages.timestamp"
            ),
        )


def _mcap(path: Path) -> Iterator[_Message]:
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            if schema is not None:
                yield _Message(channel.topic, schema.name, message.data)


def _captured(path: Path) -> Iterator[bytes]:
    """Yield the payloads of UDP over IPv4 in a capture of Ethernet, unfragmented."""
    data = memoryview(path.read_bytes())
    (magic,) = struct.unpack_from("<I", data)
    if magic not in _PCAP:
        raise UserError(f"{path}: not a pcap file; a pcapng file must be converted first")
    order, at = _PCAP[magic], 24
    while at + 16 <= len(data):
        (size,) = struct.unpack_from(f"{order}I", data, at + 8)
        frame = data[at + 16 : at + 16 + size]
        at += 16 + size
        if len(frame) > 42 and bytes(frame[12:14]) == b"\x08\x00" and frame[23] == 17:
            yield bytes(frame[14 + 4 * (frame[14] & 15) + 8 :])


def _ouster(path: Path) -> Firings:
    """Return the firings of an Ouster, in millimeters as its packets have them."""
    try:
        from ouster.sdk import open_source
    except ModuleNotFoundError:
        # It demands an exact version of rosbags, so no extra can install both.
        raise RequirementError(
            f"{path}: recordings of an Ouster need ouster-sdk, which is not installed. Fix: "
            "pip install --no-deps ouster-sdk"
        ) from None
    parts = []
    for frames in open_source(str(path)):
        for frame in frames:
            if frame is None:
                continue
            range_m = frame.field("RANGE").T * 1e-3
            light = "REFLECTIVITY" if frame.has_field("REFLECTIVITY") else "SIGNAL"
            # The columns are in the order of firing, each row with its own azimuth offset.
            azimuth = -np.arange(len(range_m)) * (2 * np.pi / len(range_m))
            parts.append(Firings(range_m, frame.field(light).T.astype(float), -azimuth[1]))
    if not parts:
        raise UserError(
            f"{path}: no frames of a LiDAR; expected a capture of an Ouster or Velodyne"
        )
    return joined(parts)
