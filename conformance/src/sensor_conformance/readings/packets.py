# SPDX-License-Identifier: Apache-2.0
"""Packets of devices as they leave the device: Velodyne, Ouster, Hesai and Livox."""

import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sensor_conformance.sources.pcap import (
    HESAI,
    LEGACY_LENGTHS,
    LIVOX,
    LIVOX_HEADER,
    LIVOX_POINTS,
    OUSTER,
    OUSTER_IMU,
    VELODYNE,
    hesai_length,
)

from .base import Floats, Times, TopicReadings, nanoseconds

COLUMNS = 16
"""Columns in a lidar packet of Ouster."""


class PacketReadings(TopicReadings):
    """Packets of one kind: bytes and time of arrival of each."""

    length = 0
    """Bytes of a packet, 0 if devices differ."""

    def prepare(self) -> None:
        """Create the lists."""
        self._packets: list[bytes] = []
        self._arrivals: list[int] = []

    def take(self, index: int, message: Any) -> None:
        """Take the packets out of a datagram, or out of a message of a driver."""
        for one in getattr(message, "packets", (message,)):
            data = bytes(getattr(one, "buf", None) or one.data)
            # A PandarPacket has 1500 bytes, of which the first `size` are the datagram.
            self._packets.append(data[: getattr(one, "size", len(data))])
            stamp = getattr(one, "stamp", None)
            self._arrivals.append(0 if stamp is None else nanoseconds(stamp))

    def finish(self) -> None:
        """Join all packets of the usual length into rows of bytes."""
        lengths = np.array([len(one) for one in self._packets], np.int64)
        self.sizes: Times = lengths
        """Bytes of each packet, of any length."""
        usual = self.length or (int(np.median(lengths)) if len(lengths) else 0)
        self.wrong_lengths = sorted(set(lengths[lengths != usual].tolist()))
        whole = [one for one in self._packets if len(one) == usual]
        self.rows = np.frombuffer(b"".join(whole), np.uint8).reshape(len(whole), usual)
        self.arrivals: Times = self.received
        """Nanoseconds, of each packet."""
        if any(self._arrivals):
            self.arrivals = np.array(self._arrivals, np.int64)

    def field(self, start: int, kind: str) -> NDArray[Any]:
        """Return a number of each packet, at a byte, in little-endian order."""
        size = np.dtype(kind).itemsize
        part = np.ascontiguousarray(self.rows[:, start : start + size])
        return part.view("<" + kind)[:, 0]


class VelodynePackets(PacketReadings):
    """Data packets of VLP-16, VLP-32C, HDL-32E and VLS-128."""

    types = (VELODYNE, "velodyne_msgs/msg/VelodyneScan")
    length = 1206

    def finish(self) -> None:
        """Take flags, azimuths, times and factory bytes."""
        super().finish()
        blocks = self.rows[:, :1200].reshape(-1, 12, 100)
        words = np.ascontiguousarray(blocks[:, :, :4]).view("<u2")
        self.flags = words[:, :, 0]
        """Marks of the 12 blocks; a VLS-128 has one for each bank of lasers."""
        self.azimuths: Floats = words[:, :, 1] / 100.0
        """Degrees, clockwise."""
        self.microseconds = self.field(1200, "u4").astype(np.int64)
        """Since the hour."""
        self.factory = self.rows[:, 1204:1206]
        """Return mode and product."""


class OusterPackets(PacketReadings):
    """Lidar packets of Ouster: legacy format, and formats with a header of 32 bytes."""

    types = (OUSTER,)

    def finish(self) -> None:
        """Take numbers and times of the columns."""
        super().finish()
        length = self.rows.shape[1]
        self.is_legacy = length in LEGACY_LENGTHS
        head, tail = (0, 0) if self.is_legacy else (32, 32)
        self.is_known = length > head + tail and (length - head - tail) % COLUMNS == 0
        size = (length - head - tail) // COLUMNS if self.is_known else 0
        starts = [head + index * size for index in range(COLUMNS)] if self.is_known else []
        kept = len(self.rows)

        def columns(offset: int, kind: str) -> NDArray[np.int64]:
            parts = [self.field(start + offset, kind).astype(np.int64) for start in starts]
            return np.stack(parts, axis=1).reshape(-1) if parts and kept else np.zeros(0, np.int64)

        self.times: Times = columns(0, "u8")
        """Nanoseconds by the device's clock, of each column."""
        self.measurements = columns(8, "u2")
        """Numbers of columns in the revolution."""
        if self.is_legacy:
            self.is_valid = columns(size - 4, "u4") == 0xFFFFFFFF
            self.frame_numbers = columns(10, "u2")
        else:
            self.is_valid = (columns(10, "u2") & 1) == 1
            # Formats for functional safety have a longer number after one byte of type.
            at, kind = (2, "u2") if kept and self.rows[0, 1] == 0 else (4, "u4")
            self.frame_numbers = np.repeat(self.field(at, kind).astype(np.int64), len(starts))


class OusterImuPackets(PacketReadings):
    """IMU packets of Ouster."""

    types = (OUSTER_IMU,)
    length = 48

    def finish(self) -> None:
        """Take times and vectors."""
        super().finish()
        self.times: Times = self.field(16, "u8").astype(np.int64)
        """Nanoseconds of the gyroscope's reading."""
        self.acceleration: Floats = self._vector(24)
        """g."""
        self.gyro: Floats = self._vector(36)
        """Degrees/s."""

    def _vector(self, start: int) -> Floats:
        return np.stack(
            [self.field(start + 4 * axis, "f4").astype(np.float64) for axis in range(3)], axis=1
        )


class HesaiPackets(PacketReadings):
    """Point cloud packets of PandarXT-16, PandarXT-32 and PandarXT-32M2X."""

    types = (HESAI, "pandar_msgs/msg/PandarScan")

    def finish(self) -> None:
        """Take azimuths, times, return modes, speeds and sequence numbers."""
        super().finish()
        size = self.rows.shape[1]
        self.headers = np.unique(self.rows[:, :12], axis=0)
        """Distinct headers; those of a recording are all the same."""
        self.is_known = (
            size > 0 and len(self.headers) == 1 and hesai_length(self.headers[0].tobytes()) == size
        )
        if not self.is_known:
            return
        header = self.headers[0]
        lasers, blocks = int(header[6]), int(header[7])
        block = 2 + 4 * lasers
        body = self.rows[:, 12 : 12 + blocks * block].reshape(-1, blocks, block)
        words = np.ascontiguousarray(body[:, :, :2]).view("<u2")
        self.azimuths: Floats = words[:, :, 0] / 100.0
        """Degrees, clockwise, of each block."""
        tail = 12 + blocks * block + 10
        self.modes = self.rows[:, tail]
        """Return modes."""
        self.rpm: Floats = self.field(tail + 1, "u2").astype(np.float64)
        self.dates = self.rows[:, tail + 3 : tail + 9]
        """Year since 1900, month, day, hour, minute and second."""
        self.microseconds = self.field(tail + 9, "u4").astype(np.int64)
        """Of the second."""
        year, month, *clock = self.dates.astype(np.int64).T
        months = ((year - 70) * 12 + month - 1).astype("M8[M]").astype("M8[D]").astype(np.int64)
        day, hour, minute, second = clock
        seconds = (((months + day - 1) * 24 + hour) * 60 + minute) * 60 + second
        self.times: Times = seconds * 10**9 + self.microseconds * 1000
        """UTC in nanoseconds."""
        self.numbers: Times | None = None
        """Sequence numbers, if the device counts."""
        if header[11] & 1:
            self.numbers = self.field(tail + 14, "u4").astype(np.int64)


class LivoxPackets(PacketReadings):
    """Point packets of Livox LiDARs of SDK 2: Mid-360, HAP."""

    types = (LIVOX,)

    def finish(self) -> None:
        """Take the header's fields, checksums and coordinates."""
        super().finish()
        self.is_known = self.rows.shape[1] > LIVOX_HEADER
        if not self.is_known:
            return
        self.versions = self.rows[:, 0]
        self.lengths = self.field(1, "u2")
        self.intervals: Times = self.field(3, "u2").astype(np.int64) * 100
        """Nanoseconds from the first point of a packet to that of the next."""
        self.points = self.field(5, "u2").astype(np.int64)
        """Points of each packet."""
        self.numbers: Times = self.field(7, "u2").astype(np.int64)
        """Of packets within a frame."""
        self.data_types, self.time_types = self.rows[:, 10], self.rows[:, 11]
        self.checksums = self.field(24, "u4")
        self.computed = np.array([zlib.crc32(row[28:].tobytes()) for row in self.rows], np.uint32)
        """What the checksums of the packets must be."""
        self.times: Times = self.field(28, "u8").astype(np.int64)
        """Nanoseconds of the first point."""

    def coordinates(self) -> Floats | None:
        """Return x, y, z in meters of all points; None if the packets have no coordinates."""
        kinds = {1: ("<i4", 1e-3), 2: ("<i2", 1e-2)}
        kind = int(self.data_types[0])
        body = self.rows[:, LIVOX_HEADER:]
        if kind not in kinds or body.shape[1] % LIVOX_POINTS[kind]:
            return None
        number, unit = kinds[kind]
        spots = body.reshape(-1, LIVOX_POINTS[kind])
        xyz = np.ascontiguousarray(spots[:, : 3 * np.dtype(number).itemsize]).view(number)
        return np.asarray(xyz * unit, np.float64)
