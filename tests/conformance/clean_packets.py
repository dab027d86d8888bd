# SPDX-License-Identifier: Apache-2.0
"""Clean packets of LiDARs, made of numbers: they turn slowly, with few packets."""

import struct
import zlib
from types import SimpleNamespace as Message

import numpy as np

from sensor_conformance.sources.source import Received

EPOCH = 1_700_000_000_000_000_000


def received(rows: list[tuple[int, Message]]) -> list[Received]:
    delays = np.random.default_rng(1).uniform(1e6, 3e6, len(rows)).astype(int)
    return [Received(at + int(late), row) for (at, row), late in zip(rows, delays, strict=True)]


def velodyne() -> list[Received]:
    """Return packets of a VLP-16 that turns slowly: 5 ms and 18 degrees a packet."""
    rows = []
    for index in range(500):
        packet = np.zeros(1206, np.uint8)
        blocks = packet[:1200].reshape(12, 100)
        azimuths = (np.arange(12) * 150 + index * 1800) % 36000
        blocks[:, :4] = np.stack((np.full(12, 0xEEFF), azimuths), 1).astype("<u2").view(np.uint8)
        packet[1200:1204] = np.array([10_000_000 + index * 5000], "<u4").view(np.uint8)
        packet[1204:] = 0x37, 0x22
        rows.append((EPOCH + index * 5_000_000, Message(data=packet)))
    return received(rows)


def ouster() -> list[Received]:
    """Return legacy packets of 16 rows: two revolutions of 512 columns."""
    size = 16 + 16 * 12 + 4
    rows = []
    for index in range(64):
        packet = np.zeros((16, size), np.uint8)
        columns = np.arange(16) + index * 16
        times = 5_000_000_000 + columns * 195_000
        packet[:, :8] = times[:, None].astype("<u8").view(np.uint8)
        packet[:, 8:10] = (columns % 512)[:, None].astype("<u2").view(np.uint8)
        packet[:, 10:12] = (columns // 512)[:, None].astype("<u2").view(np.uint8)
        packet[:, -4:] = 0xFF
        rows.append((EPOCH + index * 3_120_000, Message(data=packet.reshape(-1))))
    return received(rows)


def ouster_imu() -> list[Received]:
    noise = np.random.default_rng(10)
    rows = []
    for index in range(50):
        times = np.full(3, 5_000_000_000 + index * 10_000_000).astype("<u8")
        vectors = noise.normal((0, 0, 1, 0, 0, 0), 0.01).astype("<f4")
        data = np.concatenate((times.view(np.uint8), vectors.view(np.uint8)))
        rows.append((EPOCH + index * 10_000_000, Message(data=data)))
    return received(rows)


def hesai() -> list[Received]:
    """Return packets of a PandarXT-32 with two returns: 5 ms and 12 degrees a packet."""
    rows = []
    for index in range(500):
        packet = np.zeros(1080, np.uint8)
        packet[:12] = 0xEE, 0xFF, 6, 1, 0, 0, 32, 8, 1, 4, 2, 1
        azimuths = (np.repeat(np.arange(4), 2) * 300 + index * 1200) % 36000
        blocks = packet[12:1052].reshape(8, 130)
        blocks[:, :2] = azimuths[:, None].astype("<u2").view(np.uint8)
        micros, second = index * 5000 % 1_000_000, 58 + index * 5000 // 1_000_000
        minute, second = 59 + second // 60, second % 60
        clock = (123, 11, 14, 22 + minute // 60, minute % 60, second)
        tail = struct.pack("<BH6BIBI", 0x39, 400, *clock, micros, 0x42, 70_000 + index)
        packet[1062:] = np.frombuffer(tail, np.uint8)
        rows.append((EPOCH + index * 5_000_000, Message(data=packet)))
    return received(rows)


def checked(packet: np.ndarray) -> np.ndarray:
    """Put the checksum into a packet of Livox, and return it."""
    packet[24:28].view("<u4")[0] = zlib.crc32(packet[28:].tobytes())
    return packet


def livox() -> list[Received]:
    """Return packets of a Mid-360 with 96 points: 5 ms a packet, 20 packets a frame."""
    noise = np.random.default_rng(11)
    rows = []
    for index in range(500):
        packet = np.zeros(36 + 96 * 14, np.uint8)
        head = struct.pack("<BHHHHBBB", 0, len(packet), 50_000, 96, index % 20, 0, 1, 1)
        packet[: len(head)] = np.frombuffer(head, np.uint8)
        packet[28:36].view("<u8")[0] = EPOCH + index * 5_000_000
        spots = packet[36:].reshape(96, 14)
        places = noise.uniform(-8000, 8000, (96, 3)).astype("<i4")
        places[::7] = 0
        spots[:, :12] = places.view(np.uint8)
        spots[:, 12] = 40
        rows.append((EPOCH + index * 5_000_000, Message(data=checked(packet))))
    return received(rows)


TOPICS = {
    "/velodyne": ("velodyne/packet", velodyne),
    "/ouster": ("ouster/lidar_packet", ouster),
    "/ouster_imu": ("ouster/imu_packet", ouster_imu),
    "/hesai": ("hesai/packet", hesai),
    "/livox": ("livox/point_packet", livox),
}
