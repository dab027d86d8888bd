# SPDX-License-Identifier: Apache-2.0
"""LiDAR packets of Ouster devices: profiles LEGACY and RNG19_RFL8_SIG16_NIR16.

The functions convert arrays to bytes. They open no sockets and do not group columns into packets.
Source: Ouster's Firmware User Manual, "Lidar Data Packet Format". What it leaves open is as in
recordings among the tests of ouster-sdk: an OS-1-32 with firmware 2.1.1 (LEGACY), an OS-0-128 with
3.2.0 (header and footer of the later profiles).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.sensors.rays.kernels import kernels
from services.sensors.rays.scene import Reals

COLUMNS = 16
"""Columns of a packet; a column is a firing of all lasers."""

PIXEL = np.dtype(
    {
        "names": ["range_mm", "reflectivity", "signal", "near_ir"],
        "formats": ["<u4", "u1", "<u2", "<u2"],
        "offsets": [0, 4, 6, 8],
        "itemsize": 12,
    }
)
"""Measurement of one laser; range 0 for none. Profiles differ in the number of bits of the range,
whose other bits are flags."""

SIGNAL_AT_1M = 1400
"""Photons per percent of reflectivity at 1 m. The median of the OS-1-32's recording beyond 20 m is
1424. Nearer than 20 m the device receives less than this, over the distance squared."""

ENCODER_COUNTS = 90112
"""Encoder counts of a revolution."""

_LIDAR_PACKET = 1

Pixels = NDArray[np.void]


class Profile(NamedTuple):
    """Format of a packet."""

    name: str
    """`udp_profile_lidar` of a device's configuration."""

    range_bits: int

    packet: list[tuple[str, str]]
    """Fields before the columns, and their types."""

    column: list[tuple[str, str]]
    """Fields of a column before its pixels."""

    column_tail: list[tuple[str, str]]
    """Fields of a column after its pixels."""

    packet_tail: list[tuple[str, str]]
    """Fields after the columns."""

    status: int
    """Of a column with a valid measurement."""

    @property
    def max_range_mm(self) -> int:
        """Largest range that a packet can hold."""
        return (1 << self.range_bits) - 1

    def layout(self, lasers: int) -> np.dtype[np.void]:
        """Return the record of a packet with pixels for so many lasers in each column."""
        column = [*self.column, ("pixels", PIXEL, lasers), *self.column_tail]
        return np.dtype([*self.packet, ("columns", column, COLUMNS), *self.packet_tail])


LEGACY = Profile(
    name="LEGACY",
    range_bits=20,
    packet=[],
    column=[
        ("timestamp", "<u8"),
        ("measurement_id", "<u2"),
        ("frame_id", "<u2"),
        ("encoder_count", "<u4"),
    ],
    column_tail=[("status", "<u4")],
    packet_tail=[],
    status=0xFFFFFFFF,
)

RNG19_RFL8_SIG16_NIR16 = Profile(
    name="RNG19_RFL8_SIG16_NIR16",
    range_bits=19,
    packet=[
        ("packet_type", "<u2"),
        ("frame_id", "<u2"),
        ("initialization_id", "V3"),
        ("serial_number", "V5"),
        ("alerts", "V20"),
    ],
    column=[("timestamp", "<u8"), ("measurement_id", "<u2"), ("status", "<u2")],
    column_tail=[],
    packet_tail=[("reserved", "V24"), ("crc", "<u8")],
    status=1,
)


def pixels(profile: Profile, points: NDArray[np.void], range_m: Reals) -> Pixels:
    """Convert points to the format of a packet.

    Ranges that a packet can't hold become 0, no return. The signal follows from reflectivity and
    range. No sunlight is modeled: `near_ir` is 0.

    Parameters
    ----------
    points : records with an `intensity`
        It is the reflectivity: 0..100 diffuse, above by retroreflectors.
    range_m : float32 array of the same shape
    """
    found = np.zeros(range_m.shape, PIXEL)
    range_mm = np.rint(range_m * np.float32(1000))
    found["range_mm"] = np.where(range_mm <= profile.max_range_mm, range_mm, 0)
    found["reflectivity"] = np.rint(points["intensity"]).clip(0, 255)
    signal = SIGNAL_AT_1M * points["intensity"] / np.maximum(range_m, np.float32(1e-3)) ** 2
    found["signal"] = np.rint(signal).clip(0, 0xFFFF)
    return found


def lidar_packets(
    profile: Profile,
    measured: Pixels,
    columns: NDArray[np.integer],
    columns_per_frame: int,
    stamps_nanos: NDArray[np.integer],
    identity: tuple[int, int],
) -> list[bytes]:
    """Return complete LiDAR packets.

    Parameters
    ----------
    measured : `PIXEL` array, shape (columns, lasers)
        Lasers from the highest to the lowest; a multiple of `COLUMNS` columns.
    columns : shape (columns,)
        Number of each column, counted from the first of frame 0.
    stamps_nanos : shape (columns,)
        UTC of each column, in nanoseconds since 1970.
    identity : tuple
        Number of the device's last start (24 bits), and serial number (40 bits).
    """
    lasers = measured.shape[1]
    packets = np.zeros(len(measured) // COLUMNS, profile.layout(lasers))
    frames, measurements = np.divmod(columns.reshape(-1, COLUMNS), columns_per_frame)
    initialization_id, serial_number = identity
    of_columns = {
        "timestamp": stamps_nanos.reshape(-1, COLUMNS),
        "measurement_id": measurements,
        "frame_id": frames % 0x10000,
        "encoder_count": measurements * (ENCODER_COUNTS // columns_per_frame),
        "status": profile.status,
        "pixels": measured.reshape(-1, COLUMNS, lasers),
    }
    of_packets = {
        "packet_type": _LIDAR_PACKET,
        "frame_id": frames[:, 0] % 0x10000,
        "initialization_id": np.void(initialization_id.to_bytes(3, "little")),
        "serial_number": np.void(serial_number.to_bytes(5, "little")),
    }
    for records, values in ((packets, of_packets), (packets["columns"], of_columns)):
        for field in values.keys() & set(records.dtype.names or ()):
            records[field] = values[field]
    if profile.packet_tail:
        kernels().groundlink_crc64(packets.ctypes.data, len(packets), packets.itemsize)
    return [packet.tobytes() for packet in packets]
