# SPDX-License-Identifier: Apache-2.0
"""Firings out of recordings of LiDARs: bags, MCAP files, captures of packets, Ouster's files.

A bag or an MCAP file may hold sensor_msgs/PointCloud2 with `ring` and `intensity`, or packets as
the drivers of Velodyne and Hesai record them (velodyne_msgs/VelodyneScan, pandar_msgs/PandarScan).
"""

import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from groundlink.core.errors import RequirementError, UserError
from groundlink.data.ros_arrays import content

from .firings import Firings, joined, of_cloud
from .messages import MESSAGES, UNREADABLE, BagMessage, found_file, one_topic
from .packets import of_packets

CLOUD = "sensor_msgs/msg/PointCloud2"
PACKETS = {
    "velodyne_msgs/msg/VelodyneScan": (1206, 0),
    "pandar_msgs/msg/PandarScan": (1500, 4),
}
"""Types of messages of packets: bytes that a packet has room for, and bytes of its size after."""

_PCAP = {0xA1B2C3D4: "<", 0xA1B23C4D: "<", 0xD4C3B2A1: ">", 0x4D3CB2A1: ">"}


def read_firings(path: Path, topic: str | None = None) -> Firings:
    """Return the firings of a recording.

    Parameters
    ----------
    path : Path
        A bag (`.db3`, its folder, or `.bag`), an MCAP file, a capture (`.pcap`) of a Velodyne or a
        Hesai, or of an Ouster with its metadata beside it, or an `.osf` file.
    topic : str or None
        Needed where a bag has several topics of clouds or packets.

    Raises
    ------
    UserError
        when there are none, or nothing says which.
    """
    path = found_file(path)
    try:
        if path.suffix in MESSAGES:
            return _of_messages(path, topic)
        if path.suffix == ".osf":
            return _ouster(path)
        if path.suffix == ".pcap":
            packets = list(_captured(path))
            try:
                return of_packets(packets, str(path))
            except UserError:
                return _ouster(path)
    except UNREADABLE as error:
        raise UserError(f"{path}: cannot be read: {error}") from None
    raise UserError(f"{path}: expected a .db3, .mcap, .pcap or .osf file, or the folder of a bag")


def _of_messages(path: Path, topic: str | None) -> Firings:
    # The layout of packets differs in ROS 1.
    types = (CLOUD,) if path.suffix == ".bag" else (CLOUD, *PACKETS)
    known = one_topic(path, lambda m: m.ros_type in types, topic, "clouds or packets")
    if known[0].ros_type == CLOUD:
        clouds = (content(message.content()) for message in known)
        return joined(of_cloud(_checked(path, cloud)) for cloud in clouds)
    packets = [packet for message in known for packet in _packets(message)]
    return of_packets(packets, f"{path}: {known[0].topic}")


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


def _packets(message: BagMessage) -> Iterator[bytes]:
    """Yield the packets in a scan: a header, then a list of stamp, data and perhaps size."""
    size, after = PACKETS[message.ros_type]
    cdr = memoryview(message.data)[4:]
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
