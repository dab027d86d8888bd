# SPDX-License-Identifier: Apache-2.0
"""Point cloud packets of the Hesai PandarXT-32.

The functions convert arrays to bytes. They open no sockets and do not group firings into packets.
Source: PandarXT User Manual, section 3.1 (structure and fields); decoder of tier4/nebula
(`pandar_xt32.hpp`: order of the tail's fields, instants of blocks). What both leave open is as in a
recording among nebula's tests, of dual returns at 10 Hz.
"""

from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from services.sensors.rays.scene import Reals

LASERS = 32
BLOCKS = 8
"""Blocks of a packet. In dual return mode each return has a block."""

LASER_MICROS = 1.512
"""Time from a laser to the next, from the highest down."""

FIRING_MICROS = 50.0
STAMP_AFTER_LAST_FIRING_MICROS = -6.0
"""The stamp of a packet is that much before the first laser of its last firing."""

AZIMUTH_STEP_DEG = 0.01
RANGE_STEP_M = 0.004
_MAX_STEPS = 0xFFFF
MAX_RANGE_M = _MAX_STEPS * RANGE_STEP_M

STRONGEST, LAST, DUAL = 0x37, 0x38, 0x39
"""Return modes."""

_RESERVED = 0xFF
_FIRST_BLOCK_RETURN = 1
_MOST_RETURNS = 2
_HAS_SEQUENCE = 1
_HEADER = bytes(
    [
        *(0xEE, 0xFF, 6, 1, 0, 0),
        *(LASERS, BLOCKS, _FIRST_BLOCK_RETURN, round(RANGE_STEP_M * 1000)),
        *(_MOST_RETURNS, _HAS_SEQUENCE),
    ]
)
_FACTORY = 0x42
_SECOND_NANOS = 1_000_000_000

ECHO = np.dtype([("distance", "<u2"), ("reflectivity", "u1"), ("reserved", "u1")])
"""Return of one laser, in steps of 4 mm; distance 0 for none."""

_BLOCK = np.dtype([("azimuth", "<u2"), ("echoes", ECHO, LASERS)])
_PACKET = np.dtype(
    [
        ("header", f"V{len(_HEADER)}"),
        ("blocks", _BLOCK, BLOCKS),
        ("status", "V10"),
        ("return_mode", "u1"),
        ("motor_rpm", "<u2"),
        ("date_time", "u1", 6),
        ("micros", "<u4"),
        ("factory", "u1"),
        ("sequence", "<u4"),
    ]
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
    measured: Echoes,
    azimuths_deg: NDArray[np.floating],
    stamps_nanos: Sequence[int],
    numbers: range,
    mode: int,
    motor_rpm: int,
) -> list[bytes]:
    """Return complete packets of 1080 bytes each.

    Parameters
    ----------
    measured : `ECHO` array, shape (firings, returns, 32)
        Lasers from the highest down, with one return or, with `DUAL`, two. The nearer of two goes
        to the first block, as in all 8,829 pairs of the recording.
    azimuths_deg : shape (firings,)
        Azimuth of each firing, clockwise, 0..360.
    stamps_nanos : sequence with one item per packet
        UTC of each packet, in nanoseconds since 1970.
    numbers : range
        Sequence number of each packet.
    mode : int
        Return mode.
    """
    packets = np.zeros(len(numbers), _PACKET)
    returns = measured.shape[1]
    if returns > 1:
        by_distance = np.argsort(measured["distance"], axis=1, kind="stable")
        measured = np.take_along_axis(measured, by_distance, axis=1)
    # Axes: packet, firing, return.
    blocks = packets["blocks"].reshape(len(numbers), BLOCKS // returns, returns)
    hundredths = np.rint(azimuths_deg / AZIMUTH_STEP_DEG) % 36000
    blocks["azimuth"] = hundredths.reshape(*blocks.shape[:2], 1)
    blocks["echoes"] = measured.reshape(*blocks.shape, LASERS)
    blocks["echoes"]["reserved"] = _RESERVED
    packets["header"] = np.void(_HEADER)
    packets["return_mode"], packets["motor_rpm"], packets["factory"] = mode, motor_rpm, _FACTORY
    seconds, micros = np.divmod((np.array(stamps_nanos, np.int64) + 500) // 1000, 1_000_000)
    packets["date_time"] = np.array([_date_time(int(second)) for second in seconds]).reshape(-1, 6)
    packets["micros"] = micros
    packets["sequence"] = [number % 2**32 for number in numbers]
    return [packet.tobytes() for packet in packets]


def _date_time(second: int) -> tuple[int, ...]:
    """Return year since 1900, month, day, hour, minute and second of a UTC second since 1970."""
    year, *others = datetime.fromtimestamp(second, UTC).timetuple()[:6]
    return year - 1900, *others
