# SPDX-License-Identifier: Apache-2.0
"""The VLP-16's packets, read byte by byte as the manual's tables have them."""

import struct
from datetime import UTC, datetime

import numpy as np
import pytest

from groundlink.messages.base import POINT
from services.sensors.lidar.native import vlp16_packets as packets

NOON_NANOS = int(datetime(2024, 3, 9, 12, 0, 1, tzinfo=UTC).timestamp()) * 10**9 + 200_000_700


def numbered(firings: int, returns: int) -> packets.Echoes:
    """Echoes that are all different."""
    measured = np.zeros((firings, returns, 16), packets.ECHO)
    count = np.arange(measured.size).reshape(measured.shape)
    measured["distance"], measured["reflectivity"] = 1 + count, count % 251
    return measured


@pytest.mark.parametrize(("returns", "mode"), [(1, 0x37), (1, 0x38), (2, 0x39)])
def test_every_byte_of_a_data_packet(returns: int, mode: int) -> None:
    firings = 24 // returns
    measured, azimuths_deg = numbered(2 * firings, returns), 353.0 + 0.2 * np.arange(2 * firings)
    sent = packets.data_packets(
        measured, azimuths_deg % 360, [NOON_NANOS, NOON_NANOS + 1_327_104], mode
    )
    assert [len(packet) for packet in sent] == [1206, 1206]
    for number, packet in enumerate(sent):
        for block in range(12):
            # "Last" in blocks 0, 2 .. and the other in 1, 3 .. where there are two of each firing.
            pair, which = divmod(block, returns)
            first = number * firings + 2 * pair
            at = 100 * block
            assert packet[at : at + 2] == b"\xff\xee"
            azimuth = round(35300 + 20 * first) % 36000
            assert struct.unpack_from("<H", packet, at + 2) == (azimuth,)
            for channel in range(32):
                echo = measured[first + channel // 16, which, channel % 16]
                expected = int(echo["distance"]), int(echo["reflectivity"])
                assert struct.unpack_from("<HB", packet, at + 4 + 3 * channel) == expected
        (micros,) = struct.unpack_from("<I", packet, 1200)
        assert micros == 1_200_001 + 1327 * number
        assert packet[1204:] == bytes([mode, 0x22])


def test_a_turn_has_36000_hundredths() -> None:
    azimuths_deg = np.full(24, 359.994)
    azimuths_deg[2] = 359.996
    (packet,) = packets.data_packets(numbered(24, 1), azimuths_deg, [0], 0x37)
    assert struct.unpack_from("<H", packet, 2) == (35999,)
    assert struct.unpack_from("<H", packet, 102) == (0,)


def test_distances_are_in_steps_of_2_mm_as_far_as_two_bytes_go() -> None:
    range_m = np.array([0.0009, 0.5, 1.0031, 131.0702, 131.0715, np.inf], np.float32)
    points = np.zeros(6, POINT)
    points["intensity"] = [-3, 0, 77.6, 100, 255, 300]
    found = packets.echoes(points, range_m)
    assert found["distance"].tolist() == [0, 250, 502, 65535, 0, 0]
    assert found["reflectivity"].tolist() == [0, 0, 78, 100, 255, 255]


@pytest.mark.parametrize(
    ("since_hour_nanos", "micros"),
    [(499, 0), (500, 1), (3_599_999_999_499, 3_599_999_999), (3_599_999_999_500, 0)],
)
def test_an_hour_has_3600_million_microseconds(since_hour_nanos: int, micros: int) -> None:
    stamp_nanos = 472_222 * 3_600_000_000_000 + since_hour_nanos
    (data,) = packets.data_packets(numbered(24, 1), np.zeros(24), [stamp_nanos], 0x37)
    for packet, at in ((data, 1200), (packets.position_packet(stamp_nanos), 198)):
        assert struct.unpack_from("<I", packet, at) == (micros,)


def test_every_byte_of_a_position_packet() -> None:
    packet = packets.position_packet(NOON_NANOS)
    sentence = b"$GPRMC,120001.00,V,,,,,,,090324,,,N*73\r\n"
    time_and_pps = struct.pack("<IBxxx", 1_200_001, 2)
    assert packet == bytes(198) + time_and_pps + sentence + bytes(512 - 206 - len(sentence))


def test_others_read_the_same_from_a_position_packet() -> None:
    decoder, pynmea2 = pytest.importorskip("velodyne_decoder"), pytest.importorskip("pynmea2")
    read = decoder.TelemetryPacket(packets.position_packet(NOON_NANOS))
    assert read.usec_since_toh == 1_200_001
    assert read.pps_status.name == "LOCKED"
    sentence = pynmea2.parse(read.nmea_sentence, check=True)
    assert sentence.datetime == datetime(2024, 3, 9, 12, 0, 1, tzinfo=UTC)
    assert sentence.status == "V"
