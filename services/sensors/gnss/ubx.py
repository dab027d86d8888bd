# SPDX-License-Identifier: Apache-2.0
"""UBX messages of a u-blox receiver: NAV-DOP, NAV-PVT, NAV-HPPOSLLH and NAV-SAT.

The functions are pure: numbers in, bytes out. Layouts: u-blox ZED-F9P interface description
(UBX-18010854), chapters 5.3, 5.4 and 5.14; all numbers are little-endian. Values beyond a field's
range are limited to it.
"""

import math
import struct
from collections.abc import Iterable
from datetime import UTC, datetime
from typing import NamedTuple

from groundlink.core.clock import NANOS
from groundlink.core.fields import Vector3
from services.sensors.runtime.nmea import Epoch

from .dilution import Geometry

SYNC = b"\xb5\x62"
NAV = 0x01
DOP, PVT, HPPOSLLH, SAT = 0x04, 0x07, 0x14, 0x35
"""Class and numbers of the messages."""

LEAP_SECONDS = 18
"""GPS time minus UTC, since 2017-01-01 (IERS Bulletin C 52)."""

GPS_EPOCH_S = 315_964_800
"""1980-01-06, 0 h UTC, in seconds since 1970."""

WEEK_MS = 7 * 24 * 3600 * 1000

UNKNOWN = 2**32 - 1
"""Accuracy of an unknown value."""

NO_DILUTION = 99.99

GNSS_IDS = {"gps": 0, "galileo": 2, "beidou": 3, "glonass": 6}
"""gnssId by `Walker.system`: the same document, 1.5.1."""

_PVT = struct.Struct("<IH6BIi4B4i2I5i2I2H4xihH")
_DOP = struct.Struct("<I7H")
_HPPOSLLH = struct.Struct("<B2xBI4i4b2I")
_SATS, _SAT = struct.Struct("<IBB2x"), struct.Struct("<3BbhhI")

_TIME_VALID = 0b111
"""valid of NAV-PVT: date and time are valid, and resolved to the second."""

_TIME_CONFIRMED = 0b1110_0000
"""flags2 of NAV-PVT."""

_FIX_3D = 3
_FIX_OK, _DIFFERENTIAL = 1 << 0, 1 << 1
_CARRIER = {5: 1 << 6, 4: 2 << 6}
"""flags of NAV-PVT; those of the carrier solution by quality in GGA, floating or fixed."""

_INVALID_POSITION = 1
_FRESH_CORRECTIONS = 1 << 1
"""flags3 of NAV-PVT: age of the last correction up to 1 s."""

_SEARCHING, _CODE_LOCKED, _CARRIER_LOCKED = 1, 4, 7
_USED, _HEALTHY, _CORRECTED = 1 << 3, 1 << 4, 1 << 6
_EPHEMERIS = 1 << 8 | 1 << 11 | 1 << 12
"""flags of NAV-SAT: quality of the signal, use, health, and an ephemeris and almanac at hand."""

_SBAS_USED, _RTCM_USED, _RANGE_CORRECTED, _CARRIER_CORRECTED = 1 << 16, 1 << 17, 1 << 20, 1 << 21


class Motion(NamedTuple):
    """Vertical velocity and standard deviations, beyond what NMEA has."""

    up_mps: float
    stddev_enu_m: Vector3
    speed_stddev_mps: float


class SatelliteSignal(NamedTuple):
    """A satellite above the horizon, and its signal."""

    system: str
    number: int
    azimuth_deg: float
    elevation_deg: float
    strength_dbhz: float
    """C/N0; 0 if not received."""

    residual_m: float
    direct: bool
    used: bool


def frame(number: int, payload: bytes) -> bytes:
    """Return a message of the class NAV with its checksum, an 8-bit Fletcher sum (RFC 1145)."""
    body = struct.pack("<BBH", NAV, number, len(payload)) + payload
    a = b = 0
    for byte in body:
        a = (a + byte) & 0xFF
        b = (b + a) & 0xFF
    return SYNC + body + bytes((a, b))


def itow_ms(stamp_nanos: int) -> int:
    """Return the GPS time of week of a UTC stamp, rounded to milliseconds."""
    gps_nanos = stamp_nanos + (LEAP_SECONDS - GPS_EPOCH_S) * NANOS
    return (gps_nanos + 500_000) // 1_000_000 % WEEK_MS


def nav_dop(epoch: Epoch, geometry: Geometry | None) -> bytes:
    """Return the dilutions of precision; 99.99 without a fix."""
    dilutions = [NO_DILUTION] * 7
    if geometry is not None:
        east, north, up = geometry.dilution_enu
        time = geometry.time_dilution
        position = math.hypot(east, north, up)
        dilutions = [
            *(math.hypot(position, time), position, time, up),
            *(geometry.horizontal_dilution, north, east),
        ]
    return frame(DOP, _DOP.pack(itow_ms(epoch.stamp_nanos), *map(_hundredths, dilutions)))


def nav_pvt(epoch: Epoch, geometry: Geometry | None, motion: Motion) -> bytes:
    """Return position, velocity and time, in steps of 1e-7 degrees and of a millimeter."""
    second, nanos = divmod(epoch.stamp_nanos, NANOS)
    at = datetime.fromtimestamp(second, UTC)
    clock = (at.year, at.month, at.day, at.hour, at.minute, at.second, _TIME_VALID)
    start = (itow_ms(epoch.stamp_nanos), *clock)
    if geometry is None:
        return frame(
            PVT,
            _PVT.pack(
                *(*start, UNKNOWN, nanos, 0, 0, _TIME_CONFIRMED, 0),
                *(0, 0, 0, 0, UNKNOWN, UNKNOWN, 0, 0, 0, 0, 0, UNKNOWN, 180 * 10**5),
                *(_hundredths(NO_DILUTION), _INVALID_POSITION, 0, 0, 0),
            ),
        )
    differential = epoch.quality > 1
    flags = _FIX_OK | _DIFFERENTIAL * differential | _CARRIER.get(epoch.quality, 0)
    east, north, up = motion.stddev_enu_m
    speed = math.hypot(epoch.east_mps, epoch.north_mps)
    heading_deg = math.degrees(math.atan2(epoch.east_mps, epoch.north_mps)) % 360
    heading_stddev_deg = math.degrees(math.atan2(motion.speed_stddev_mps, speed))
    velocity = (epoch.north_mps, epoch.east_mps, -motion.up_mps, speed)
    return frame(
        PVT,
        _PVT.pack(
            *(*start, 20, nanos, _FIX_3D, flags, _TIME_CONFIRMED, epoch.satellites),
            *(round(epoch.longitude_deg * 1e7), round(epoch.latitude_deg * 1e7)),
            *(round(epoch.altitude_m * 1e3), round((epoch.altitude_m - epoch.geoid_m) * 1e3)),
            *(_unsigned(math.hypot(east, north) * 1e3), _unsigned(up * 1e3)),
            *(round(each * 1e3) for each in velocity),
            round(heading_deg * 1e5),
            *(_unsigned(motion.speed_stddev_mps * 1e3), _unsigned(heading_stddev_deg * 1e5)),
            _hundredths(math.hypot(*geometry.dilution_enu)),
            *(_FRESH_CORRECTIONS * differential, 0, 0, 0),
        ),
    )


def nav_hpposllh(epoch: Epoch, motion: Motion) -> bytes:
    """Return the position in steps of 1e-9 degrees and of a tenth of a millimeter."""
    itow = itow_ms(epoch.stamp_nanos)
    if not epoch.fixed:
        unknown = (0,) * 8
        return frame(
            HPPOSLLH, _HPPOSLLH.pack(0, _INVALID_POSITION, itow, *unknown, UNKNOWN, UNKNOWN)
        )
    longitude, fine_longitude = _split(epoch.longitude_deg * 1e9, 100)
    latitude, fine_latitude = _split(epoch.latitude_deg * 1e9, 100)
    height, fine_height = _split(epoch.altitude_m * 1e4, 10)
    above_geoid, fine_above_geoid = _split((epoch.altitude_m - epoch.geoid_m) * 1e4, 10)
    east, north, up = motion.stddev_enu_m
    return frame(
        HPPOSLLH,
        _HPPOSLLH.pack(
            *(0, 0, itow, longitude, latitude, height, above_geoid),
            *(fine_longitude, fine_latitude, fine_height, fine_above_geoid),
            *(_unsigned(math.hypot(east, north) * 1e4), _unsigned(up * 1e4)),
        ),
    )


def nav_sat(epoch: Epoch, signals: Iterable[SatelliteSignal]) -> bytes:
    """Return the satellites above the horizon, received or not."""
    blocks = [
        _SAT.pack(
            *(GNSS_IDS[signal.system], signal.number, round(signal.strength_dbhz)),
            *(round(signal.elevation_deg), round(signal.azimuth_deg) % 360),
            max(-(2**15), min(round(signal.residual_m * 10), 2**15 - 1)),
            _flags(epoch.quality, signal),
        )
        for signal in signals
    ]
    return frame(SAT, _SATS.pack(itow_ms(epoch.stamp_nanos), 1, len(blocks)) + b"".join(blocks))


def _flags(quality: int, signal: SatelliteSignal) -> int:
    """Return the flags of a satellite in NAV-SAT; `quality` is that of GGA."""
    if not signal.strength_dbhz:
        return _SEARCHING | _HEALTHY | _EPHEMERIS
    flags = _CARRIER_LOCKED if signal.direct else _CODE_LOCKED
    flags |= _HEALTHY | _EPHEMERIS
    if signal.used:
        flags |= _USED
        if quality == 2:
            flags |= _CORRECTED | _SBAS_USED | _RANGE_CORRECTED
        elif quality > 2:
            flags |= _CORRECTED | _RTCM_USED | _RANGE_CORRECTED | _CARRIER_CORRECTED
    return flags


def _split(value: float, parts: int) -> tuple[int, int]:
    """Return a value in units of `parts`, and the rest of the same sign."""
    whole = round(value)
    coarse = int(whole / parts)
    return coarse, whole - coarse * parts


def _hundredths(dilution: float) -> int:
    return min(round(dilution * 100), 2**16 - 1)


def _unsigned(value: float) -> int:
    return min(round(value), UNKNOWN)
