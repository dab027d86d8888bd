# SPDX-License-Identifier: Apache-2.0
"""Packet formats of the VLP-16: data packets (port 2368) and position packets (port 8308).

The functions convert arrays to bytes. They open no sockets and do not group firings into packets.
Source of every number: VLP-16 User Manual 63-9243 Rev D, sections 9.2 to 9.4.

A packet contains the azimuth of every other firing and the instant of its first firing. A decoder
adds the constants of all devices, 55.296 us between firings and 2.304 us between lasers, and takes
the rotation rate from the packet's own azimuths.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from services.sensors.rays.scene import Reals
from services.sensors.runtime import nmea

POSITION_PORT = 8308

LASERS = 16
ELEVATIONS_DEG = (-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15)
"""Elevation by laser, in firing order."""

LASER_MICROS = 2.304
FIRING_MICROS = 55.296

AZIMUTH_STEP_DEG = 0.01

RANGE_STEP_M = 0.002
_MAX_STEPS = 0xFFFF
MAX_RANGE_M = _MAX_STEPS * RANGE_STEP_M

BLOCKS = 12
"""Number of blocks of a data packet. In dual return mode each return has a block."""

FIRINGS_PER_BLOCK = 2

STRONGEST, LAST, DUAL = 0x37, 0x38, 0x39
"""Return modes."""

_VLP16 = 0x22
_BLOCK_FLAG = 0xEEFF
_HOUR_MICROS = 3_600_000_000
_SECOND_NANOS = 1_000_000_000
_PPS_LOCKED = 2

ECHO = np.dtype([("distance", "<u2"), ("reflectivity", "u1")])
"""Return of one laser, in steps of 2 mm; distance 0 for none."""

_BLOCK = np.dtype(
    [("flag", "<u2"), ("azimuth", "<u2"), ("echoes", ECHO, (FIRINGS_PER_BLOCK, LASERS))]
)
_DATA = np.dtype(
    [("blocks", _BLOCK, BLOCKS), ("micros", "<u4"), ("return_mode", "u1"), ("product", "u1")]
)
_POSITION = np.dtype(
    {
        "names": ["micros", "pps", "sentence"],
        "formats": ["<u4", "u1", "S306"],
        "offsets": [198, 202, 206],
        "itemsize": 512,
    }
)

Echoes = NDArray[np.void]


def echoes(points: NDArray[np.void], range_m: Reals) -> Echoes:
    """Convert points to the format of a packet.

    Distances that a packet can't represent become 0, no return.

    Parameters
    ----------
    points : records with an `intensity`
    range_m : float32 array of the same shape
    """
    found = np.zeros(range_m.shape, ECHO)
    steps = np.rint(range_m / np.float32(RANGE_STEP_M))
    found["distance"] = np.where(steps <= _MAX_STEPS, steps, 0)
    found["reflectivity"] = np.rint(points["intensity"]).clip(0, 255)
    return found


def data_packets(
    measured: Echoes, azimuths_deg: NDArray[np.floating], stamps_nanos: Sequence[int], mode: int
) -> list[bytes]:
    """Return complete data packets of 1206 bytes each.

    Parameters
    ----------
    measured : `ECHO` array, shape (firings, returns, 16)
        Lasers in firing order, with one return or, with `DUAL`, two: the last, then the strongest,
        or the second strongest if the strongest is the last. With a single echo both are the same.
    azimuths_deg : shape (firings,)
        Azimuth of each firing's first laser, clockwise from the front, 0..360.
    stamps_nanos : sequence with one item per packet
        UTC of each packet's first firing, in nanoseconds since 1970.
    mode : int
        Return mode.
    """
    packets = np.zeros(len(stamps_nanos), _DATA)
    returns = measured.shape[1]
    # Axes: packet, pair of firings, return. The first of two returns goes to even blocks.
    pairs = len(packets), BLOCKS // returns
    blocks = packets["blocks"].reshape(*pairs, returns)
    hundredths = np.rint(azimuths_deg[::FIRINGS_PER_BLOCK] / AZIMUTH_STEP_DEG) % 36000
    blocks["flag"], blocks["azimuth"] = _BLOCK_FLAG, hundredths.reshape(*pairs, 1)
    of_firings = measured.reshape(*pairs, FIRINGS_PER_BLOCK, returns, LASERS)
    blocks["echoes"] = of_firings.swapaxes(2, 3)
    packets["micros"] = [_micros_of_hour(stamp) for stamp in stamps_nanos]
    packets["return_mode"], packets["product"] = mode, _VLP16
    return [packet.tobytes() for packet in packets]


def position_packet(stamp_nanos: int) -> bytes:
    """Return the 512-byte position packet of a device whose clock is locked to UTC by a PPS.

    The NMEA sentence gives the time at which the second began. The time source has no position, so
    the sentence has none either.

    Parameters
    ----------
    stamp_nanos : int
        UTC of the packet's assembly, in nanoseconds since 1970.
    """
    second = stamp_nanos // _SECOND_NANOS * _SECOND_NANOS
    sentence = nmea.rmc(nmea.Epoch(second, 0, "N"))
    packet = np.zeros((), _POSITION)
    packet["micros"], packet["pps"] = _micros_of_hour(stamp_nanos), _PPS_LOCKED
    packet["sentence"] = sentence
    return packet.tobytes()


def _micros_of_hour(stamp_nanos: int) -> int:
    """Return the number of microseconds since the full hour, rounded."""
    return (stamp_nanos + 500) // 1000 % _HOUR_MICROS
