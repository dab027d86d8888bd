# SPDX-License-Identifier: Apache-2.0
"""Packets of a Mid-360, read byte by byte as the structures of Livox-SDK2 have them."""

import struct
import zlib

import numpy as np

from groundlink.messages.base import POINT
from services.sensors.lidar.native import livox_packets as packets

STAMP_NANOS = 1_700_000_000_123_456_789


def test_every_byte_of_a_packet() -> None:
    measured = np.zeros(192, packets.SPOT)
    for axis, scale in (("x", 1), ("y", -2), ("z", 3)):
        measured[f"{axis}_mm"] = scale * np.arange(1, 193)
    measured["reflectivity"], measured["tag"] = np.arange(192) % 251, np.arange(192) % 7
    stamps = [STAMP_NANOS, STAMP_NANOS + 480_000]
    sent = packets.point_packets(measured, stamps, np.array([207, 0]))
    assert [len(packet) for packet in sent] == [1380, 1380]
    for number, packet in enumerate(sent):
        # Version, length, time interval in 0.1 us, points, packet and frame counters, types.
        header = struct.unpack_from("<BHHHHBBB", packet)
        assert header == (0, 1380, 4800, 96, (207, 0)[number], 0, 1, 1)
        assert packet[12:24] == bytes(12)
        assert struct.unpack_from("<IQ", packet, 24) == (zlib.crc32(packet[28:]), stamps[number])
        for index in range(96):
            of_all = 96 * number + index
            expected = 1 + of_all, -2 * (1 + of_all), 3 * (1 + of_all), of_all % 251, of_all % 7
            assert struct.unpack_from("<iiiBB", packet, 36 + 14 * index) == expected


def test_coordinates_are_in_millimeters() -> None:
    points = np.zeros(3, POINT)
    points["x"], points["y"], points["z"] = [0.0004, -1.2346, 3e9], [1, 2, 3], [-0.5, 0.0006, 7]
    points["intensity"] = [300, 99.6, -1]
    found = packets.spots(points, np.zeros(3, np.float32))
    assert found["x_mm"].tolist() == [0, -1235, 2**31 - 1]
    assert found["y_mm"].tolist() == [1000, 2000, 3000]
    assert found["z_mm"].tolist() == [-500, 1, 7000]
    assert found["reflectivity"].tolist() == [255, 100, 0]
