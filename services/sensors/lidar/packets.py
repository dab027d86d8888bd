# SPDX-License-Identifier: Apache-2.0
"""The VLP-16's own packets, byte by byte: what it measured (port 2368) and its clock (port 8308).

Rule: bytes from arrays; sockets, and which firings make a packet, are others' business. Source of
every number: VLP-16 User Manual 63-9243 Rev D, sections 9.2 to 9.4.

A packet tells the azimuth of every other firing and the instant of its first. A decoder adds what
is the same for all devices, 55.296 us from firing to firing and 2.304 us from laser to laser, and
takes the rate of turning from the packet's own azimuths.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from services.sensors.rays.scene import Reals
from services.sensors.runtime import nmea

POSITION_PORT = 8308

LASERS = 16
ELEVATIONS_DEG = (-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15)
"""By laser, in the order of firing."""

LASER_MICROS = 2.304
FIRING_MICROS = 55.296

AZIMUTH_STEP_DEG = 0.01

RANGE_STEP_M = 0.002
_MAX_STEPS = 0xFFFF
MAX_RANGE_M = _MAX_STEPS * RANGE_STEP_M

BLOCKS = 12
"""Of a data packet; with two returns one block for each."""

FIRINGS_PER_BLOCK = 2

STRONGEST, LAST, DUAL = 0x37, 0x38, 0x39
"""Return modes."""

_VLP16 = 0x22
_BLOCK_FLAG = 0xEEFF
_HOUR_MICROS = 3_600_000_000
_SECOND_NANOS = 1_000_000_000
_PPS_LOCKED = 2

ECHO = np.dtype([("distance", "<u2"), ("reflectivity", "u1")])
"""Of one laser, in steps of 2 mm; distance 0 for none."""

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


def echoes(range_m: Reals, intensity: Reals) -> Echoes:
    """Return what lasers measured as a packet holds it; nothing where it cannot tell the distance.

    Parameters
    ----------
    range_m, intensity : float32 arrays of one shape
    """
    found = np.zeros(range_m.shape, ECHO)
    steps = np.rint(range_m / np.float32(RANGE_STEP_M))
    found["distance"] = np.where(steps <= _MAX_STEPS, steps, 0)
    found["reflectivity"] = np.rint(intensity).clip(0, 255)
    return found


def data_packets(
    measured: Echoes, azimuths_deg: NDArray[np.floating], stamps_nanos: Sequence[int], mode: int
) -> list[bytes]:
    """Return whole packets, of 1206 bytes each.

    Parameters
    ----------
    measured : `ECHO` array, shape (firings, returns, 16)
        Lasers in the order of firing; one return, or two with `DUAL`: the last, then the strongest,
        or the second strongest where the strongest is the last; the same where there is only one.
    azimuths_deg : shape (firings,)
        Of each firing's first laser, clockwise from the front, 0..360.
    stamps_nanos : packets long
        UTC of each packet's first firing, since 1970.
    mode : int
        Return mode.
    """
    packets = np.zeros(len(stamps_nanos), _DATA)
    returns = measured.shape[1]
    # Packet, pair of firings, return: of two returns the first goes to even blocks.
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
    """Return the clock of a device that a pulse per second holds to UTC, in 512 bytes.

    The sentence is that of the second's beginning, from a source of time alone: it has no position.

    Parameters
    ----------
    stamp_nanos : int
        UTC at which the packet is put together, since 1970.
    """
    second = stamp_nanos // _SECOND_NANOS * _SECOND_NANOS
    sentence = nmea.rmc(nmea.Epoch(second, 0, "N"))
    packet = np.zeros((), _POSITION)
    packet["micros"], packet["pps"] = _micros_of_hour(stamp_nanos), _PPS_LOCKED
    packet["sentence"] = sentence
    return packet.tobytes()


def _micros_of_hour(stamp_nanos: int) -> int:
    """Return the nearest microsecond past the full hour."""
    return (stamp_nanos + 500) // 1000 % _HOUR_MICROS
