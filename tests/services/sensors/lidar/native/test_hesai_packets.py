# SPDX-License-Identifier: Apache-2.0
"""Packets of a PandarXT-32, read byte by byte as the manual's tables have them."""

import struct
from datetime import UTC, datetime

import numpy as np
import pytest

from groundlink.messages.base import POINT
from services.sensors.lidar.native import hesai_packets as packets

RECORDED_HEADER = bytes.fromhex("eeff06010000 200801040201")
RECORDED_TAIL = bytes.fromhex("39 5702 77071903131d 9d720900 42 6c9a0400")
"""Of a device with dual returns at 599 rpm, after its 10 bytes of status."""

RECORDED_NANOS = int(datetime(2019, 7, 25, 3, 19, 29, 619_165, UTC).timestamp() * 1e6) * 1000


def numbered(firings: int, returns: int) -> packets.Echoes:
    """Echoes that are all different, the nearer of two first."""
    measured = np.zeros((firings, returns, 32), packets.ECHO)
    count = np.arange(measured.size).reshape(measured.shape)
    measured["distance"], measured["reflectivity"] = 1 + count, count % 251
    return measured


@pytest.mark.parametrize(("returns", "mode"), [(1, 0x37), (1, 0x38), (2, 0x39)])
def test_every_byte_of_a_packet(returns: int, mode: int) -> None:
    firings = 8 // returns
    measured, azimuths_deg = numbered(2 * firings, returns), 359.1 + 0.18 * np.arange(2 * firings)
    sent = packets.data_packets(
        *(measured, azimuths_deg % 360, [RECORDED_NANOS, RECORDED_NANOS + 400_000_000]),
        *(range(0x49A6C, 0x49A6E), mode, 599),
    )
    assert [len(packet) for packet in sent] == [1080, 1080]
    for number, packet in enumerate(sent):
        assert packet[:12] == RECORDED_HEADER
        for block in range(8):
            firing, which = divmod(8 * number + block, returns)
            at = 12 + 130 * block
            assert struct.unpack_from("<H", packet, at) == ((35910 + 18 * firing) % 36000,)
            for channel in range(32):
                echo = measured[firing, which, channel]
                expected = int(echo["distance"]), int(echo["reflectivity"]), 0xFF
                assert struct.unpack_from("<HBB", packet, at + 2 + 4 * channel) == expected
        assert packet[1052:1062] == bytes(10)
        sequence = struct.pack("<I", 0x49A6C + number)
        assert packet[1076:] == sequence
    if mode == 0x39:
        assert sent[0][1062:] == RECORDED_TAIL
    assert sent[0][1062] == mode
    # The second began between them.
    assert sent[1][1065:1075] == bytes([119, 7, 25, 3, 19, 30]) + struct.pack("<I", 19_165)


def test_the_nearer_of_two_returns_is_in_the_first_block() -> None:
    measured = numbered(4, 2)[:, ::-1]
    (packet,) = packets.data_packets(measured, np.zeros(4), [0], range(1), 0x39, 600)
    for block in range(8):
        firing, which = divmod(block, 2)
        (distance,) = struct.unpack_from("<H", packet, 12 + 130 * block + 2)
        assert distance == measured[firing, 1 - which, 0]["distance"]


def test_sequence_and_azimuth_begin_again() -> None:
    azimuths_deg = np.array([359.994, 359.996, *[0.0] * 6])
    (packet,) = packets.data_packets(
        numbered(8, 1), azimuths_deg, [0], range(2**32 + 5, 2**32 + 6), 0x37, 600
    )
    assert struct.unpack_from("<H", packet, 12) == (35999,)
    assert struct.unpack_from("<H", packet, 142) == (0,)
    assert struct.unpack_from("<I", packet, 1076) == (5,)


def test_distances_are_in_steps_of_4_mm_as_far_as_two_bytes_go() -> None:
    range_m = np.array([0.0019, 0.5, 1.003, 262.14, 262.143, np.inf], np.float32)
    points = np.zeros(6, POINT)
    points["intensity"] = [-3, 0, 77.6, 100, 255, 300]
    found = packets.echoes(points, range_m)
    assert found["distance"].tolist() == [0, 125, 251, 65535, 0, 0]
    assert found["reflectivity"].tolist() == [0, 0, 78, 100, 255, 255]
