# SPDX-License-Identifier: Apache-2.0
"""Point cloud packets of the Livox Mid-360: data type 1, Cartesian coordinates in millimeters.

The functions convert arrays to bytes. They open no sockets and do not group points into packets.
Source: `livox_lidar_def.h` of Livox-SDK2 (structure and types); Livox wiki, communication protocol
of the Mid-360 (checksum, counters). The driver, livox_ros_driver2, takes the line of a point from
its place in the packet, and its instant from the packet's stamp and interval.
"""

import zlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from services.sensors.rays.scene import Reals

LINES = 4
POINTS = 96
"""Points of a packet, line after line; those without a return are all zeros."""

POINT_NANOS = 5000

_CARTESIAN_MILLIMETERS = 1
_PTP = 1
_MAX_MM = 2**31 - 1

SPOT = np.dtype(
    [("x_mm", "<i4"), ("y_mm", "<i4"), ("z_mm", "<i4"), ("reflectivity", "u1"), ("tag", "u1")]
)
"""A point. Tag 0 is a normal point, of high confidence."""

_PACKET = np.dtype(
    [
        ("version", "u1"),
        ("length", "<u2"),
        ("interval", "<u2"),
        ("dot_num", "<u2"),
        ("udp_cnt", "<u2"),
        ("frame_cnt", "u1"),
        ("data_type", "u1"),
        ("time_type", "u1"),
        ("reserved", "V12"),
        ("crc32", "<u4"),
        ("timestamp", "<u8"),
        ("points", SPOT, POINTS),
    ]
)
_CHECKED = 28
"""Offset from which on bytes are in the checksum."""

Spots = NDArray[np.void]


def spots(points: NDArray[np.void], range_m: Reals) -> Spots:
    """Convert points to the format of a packet.

    Parameters
    ----------
    points : `POINT` records
    range_m : float32 array of the same shape
        Not needed: the format has coordinates.
    """
    found = np.zeros(points.shape, SPOT)
    for axis in "xyz":
        millimeters = np.rint(points[axis].astype(np.float64) * 1000)
        found[f"{axis}_mm"] = millimeters.clip(-_MAX_MM, _MAX_MM)
    found["reflectivity"] = np.rint(points["intensity"]).clip(0, 255)
    return found


def point_packets(
    measured: Spots, stamps_nanos: Sequence[int], numbers: NDArray[np.integer]
) -> list[bytes]:
    """Return complete packets of 1380 bytes each.

    Parameters
    ----------
    measured : `SPOT` array, a multiple of `POINTS` long
        In the order in which they were measured, `POINT_NANOS` apart.
    stamps_nanos : sequence with one item per packet
        Instant of each packet's first point, in nanoseconds of a clock synchronized by PTP.
    numbers : integer array
        Number of each packet in its frame.
    """
    packets = np.zeros(len(stamps_nanos), _PACKET)
    packets["length"], packets["dot_num"] = _PACKET.itemsize, POINTS
    packets["interval"] = POINTS * POINT_NANOS // 100
    packets["udp_cnt"], packets["timestamp"] = numbers, stamps_nanos
    packets["data_type"], packets["time_type"] = _CARTESIAN_MILLIMETERS, _PTP
    packets["points"] = measured.reshape(-1, POINTS)
    for packet in packets:
        packet["crc32"] = zlib.crc32(packet.tobytes()[_CHECKED:])
    return [packet.tobytes() for packet in packets]
