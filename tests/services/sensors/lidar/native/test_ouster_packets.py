# SPDX-License-Identifier: Apache-2.0
"""Packets of Ouster devices, read byte by byte; headers as they were recorded of real devices."""

import lzma
import struct

import numpy as np
import pytest

from groundlink.messages.base import POINT
from services.sensors.lidar.native import ouster_packets as packets
from services.sensors.rays.kernels import kernels

STAMP_NANOS = 1_700_000_000_123_456_789
LEGACY_COLUMN = bytes.fromhex("8c47cac640000000 1000 bd00 80050000")
"""Of an OS-1-64: column 16 of frame 189."""

RNG_PACKET = bytes.fromhex("0100 fe00 f2dcad d1327d761c 90") + bytes(19)
RNG_COLUMN = bytes.fromhex("184ad782d00a0000 1000 0100")
"""Of an OS-0-128: column 16 of frame 254; 0x90 are alerts of that device."""


def numbered(columns: int, lasers: int) -> packets.Pixels:
    """Pixels that are all different."""
    measured = np.zeros((columns, lasers), packets.PIXEL)
    count = np.arange(measured.size).reshape(measured.shape)
    measured["range_mm"], measured["reflectivity"] = 1 + count, count % 251
    measured["signal"], measured["near_ir"] = count % 65521, count % 241
    return measured


@pytest.mark.parametrize(
    ("profile", "head", "column", "at_pixels", "tail"),
    [
        (packets.LEGACY, 0, 16 + 64 * 12 + 4, 16, 0),
        (packets.RNG19_RFL8_SIG16_NIR16, 32, 12 + 64 * 12, 12, 32),
    ],
)
def test_every_byte_of_a_lidar_packet(
    profile: packets.Profile, head: int, column: int, at_pixels: int, tail: int
) -> None:
    measured, first = numbered(32, 64), 254 * 1024 + 1008
    stamps = STAMP_NANOS + 97_656 * np.arange(32)
    sent = packets.lidar_packets(
        profile, measured, np.arange(first, first + 32), 1024, stamps, (0xADDCF2, 0x1C767D32D1)
    )
    assert [len(packet) for packet in sent] == [head + 16 * column + tail] * 2
    for number, packet in enumerate(sent):
        if head:
            frame = struct.pack("<H", 254 + number)
            assert packet[:32] == RNG_PACKET[:2] + frame + RNG_PACKET[4:12] + bytes(20)
            assert packet[-32:-8] == bytes(24)
        for index in range(16):
            at, of_all = head + index * column, 16 * number + index
            frame_and_id = 254 + number, (1008 + of_all) % 1024
            stamp, identity = struct.unpack_from("<QH", packet, at)
            assert (stamp, identity) == (STAMP_NANOS + 97_656 * of_all, frame_and_id[1])
            if head:
                assert struct.unpack_from("<H", packet, at + 10) == (1,)
            else:
                counts = struct.unpack_from("<HI", packet, at + 10)
                assert counts == (frame_and_id[0], 88 * frame_and_id[1])
                assert packet[at + column - 4 : at + column] == b"\xff" * 4
            for laser in range(64):
                pixel = measured[of_all, laser]
                expected = struct.pack(
                    "<IBxHHxx",
                    *(int(pixel[field]) for field in packets.PIXEL.names or ()),
                )
                begin = at + at_pixels + 12 * laser
                assert packet[begin : begin + 12] == expected


def test_headers_are_those_of_recordings() -> None:
    one = numbered(16, 64)
    (legacy,) = packets.lidar_packets(
        *(packets.LEGACY, one, 189 * 1024 + np.arange(16, 32), 1024),
        *(np.full(16, 0x40C6CA478C), (0, 0)),
    )
    assert legacy[:16] == LEGACY_COLUMN
    (rng,) = packets.lidar_packets(
        *(packets.RNG19_RFL8_SIG16_NIR16, one, 254 * 512 + np.arange(16, 32), 512),
        *(np.full(16, 0x0AD082D74A18), (0xADDCF2, 0x1C767D32D1)),
    )
    assert rng[:12] == RNG_PACKET[:12]
    assert rng[32:44] == RNG_COLUMN


def test_frames_are_counted_in_16_bits() -> None:
    columns = 0x10003 * 1024 + np.arange(16)
    (packet,) = packets.lidar_packets(
        packets.LEGACY, numbered(16, 16), columns, 1024, np.zeros(16, np.int64), (0, 0)
    )
    assert struct.unpack_from("<H", packet, 10) == (3,)


@pytest.mark.parametrize("size", [9, 17, 23])
def test_crc_is_that_of_xz(size: int) -> None:
    text = (b"123456789" * 3)[:size]
    records = np.frombuffer(2 * (text + bytes(8)), np.uint8).copy()
    kernels().groundlink_crc64(records.ctypes.data, 2, size + 8)
    xz = lzma.compress(text, check=lzma.CHECK_CRC64)
    index_size = 4 * struct.unpack_from("<I", xz, len(xz) - 8)[0] + 4
    expected = struct.unpack_from("<Q", xz, len(xz) - 12 - index_size - 8)[0]
    for record in records.reshape(2, -1):
        assert record[:size].tobytes() == text
        assert record[size:].view("<u8")[0] == expected


def test_range_is_in_millimeters_and_signal_falls_with_its_square() -> None:
    range_m = np.array([0.0004, 1.0, 1.2346, 10.0, 20.0, 40.0, 600.0, np.inf], np.float32)
    points = np.zeros(8, POINT)
    points["intensity"] = [50, 0, 300, 100, 100, 55.4, 0, 0]
    found = packets.pixels(packets.RNG19_RFL8_SIG16_NIR16, points, range_m)
    assert found["range_mm"].tolist() == [0, 1000, 1235, 10000, 20000, 40000, 0, 0]
    assert found["reflectivity"].tolist() == [50, 0, 255, 100, 100, 55, 0, 0]
    assert found["signal"].tolist() == [65535, 0, 65535, 1400, 350, 48, 0, 0]
    assert not found["near_ir"].any()
