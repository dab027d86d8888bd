# SPDX-License-Identifier: Apache-2.0
"""NMEA 0183 sentences of a GNSS receiver: GGA, RMC and VTG.

The functions are pure: numbers in, text out. Values are rounded once, in whole units of the last
decimal, so that 59.99999 minutes never become 60. Format: NMEA 0183 with the mode indicator
(version 2.3 and later). Sentences with centimeter-level solutions have seven decimals of
a minute. They exceed the standard's limit of 82 characters, as those of real receivers do.
"""

import math
from datetime import UTC, datetime
from typing import NamedTuple

KNOTS_PER_MPS = 3600 / 1852
STANDING_MPS = 0.05
"""Below this speed a receiver reports no course."""

NO_DILUTION = "99.99"


class Epoch(NamedTuple):
    """Receiver solution at one instant."""

    stamp_nanos: int
    """UTC in nanoseconds since 1970."""

    quality: int
    """GGA: 0 no fix, 1 autonomous, 2 differential, 4 fixed and 5 floating RTK."""

    mode: str
    """RMC, VTG: A autonomous, D differential, R fixed and F floating RTK; N no fix."""

    minute_decimals: int = 5
    latitude_deg: float = 0.0
    longitude_deg: float = 0.0
    altitude_m: float = 0.0
    """Altitude above the ellipsoid."""

    geoid_m: float = 0.0
    """Height of the geoid above the ellipsoid."""

    east_mps: float = 0.0
    north_mps: float = 0.0
    satellites: int = 0
    horizontal_dilution: float = 0.0
    talker: str = "GP"
    """GP for GPS alone, GN for several systems."""

    @property
    def fixed(self) -> bool:
        """Whether the solution has a position."""
        return self.quality > 0


def sentences(epoch: Epoch) -> list[bytes]:
    """Return the GGA, RMC and VTG sentences of an instant."""
    return [gga(epoch), rmc(epoch), vtg(epoch)]


def gga(epoch: Epoch) -> bytes:
    """Return the GGA sentence: position, quality and altitude above the geoid."""
    time, _ = _time_and_date(epoch)
    if not epoch.fixed:
        return sentence(f"{epoch.talker}GGA", time, *[""] * 4, "0", "00", NO_DILUTION, *[""] * 6)
    return sentence(
        *(f"{epoch.talker}GGA", time, *_position(epoch), str(epoch.quality)),
        *(f"{epoch.satellites:02d}", f"{epoch.horizontal_dilution:.2f}"),
        *(f"{epoch.altitude_m - epoch.geoid_m:.3f}", "M", f"{epoch.geoid_m:.3f}", "M", "", ""),
    )


def rmc(epoch: Epoch) -> bytes:
    """Return the RMC sentence: time, date, position, speed and course."""
    time, date = _time_and_date(epoch)
    if not epoch.fixed:
        return sentence(f"{epoch.talker}RMC", time, "V", *[""] * 6, date, "", "", epoch.mode)
    speed, course = _motion(epoch)
    knots = f"{speed * KNOTS_PER_MPS:.3f}"
    return sentence(
        *(f"{epoch.talker}RMC", time, "A", *_position(epoch)),
        *(knots, course, date, "", "", epoch.mode),
    )


def vtg(epoch: Epoch) -> bytes:
    """Return the VTG sentence: course and speed over ground."""
    if not epoch.fixed:
        return sentence(f"{epoch.talker}VTG", "", "T", "", "M", "", "N", "", "K", epoch.mode)
    speed, course = _motion(epoch)
    knots, kmh = f"{speed * KNOTS_PER_MPS:.3f}", f"{speed * 3.6:.3f}"
    return sentence(f"{epoch.talker}VTG", course, "T", "", "M", knots, "N", kmh, "K", epoch.mode)


def sentence(*fields: str) -> bytes:
    """Return a sentence with its checksum, the exclusive or of all bytes between $ and *."""
    body = ",".join(fields).encode("ascii")
    checksum = 0
    for byte in body:
        checksum ^= byte
    return b"$%s*%02X\r\n" % (body, checksum)


def _time_and_date(epoch: Epoch) -> tuple[str, str]:
    """Return the UTC time as hhmmss.ss and the date as ddmmyy."""
    seconds, hundredths = divmod((epoch.stamp_nanos + 5_000_000) // 10_000_000, 100)
    at = datetime.fromtimestamp(seconds, UTC)
    return f"{at:%H%M%S}.{hundredths:02d}", f"{at:%d%m%y}"


def _position(epoch: Epoch) -> tuple[str, str, str, str]:
    """Return latitude, N or S, longitude, and E or W."""
    decimals = epoch.minute_decimals
    return (
        _degrees_and_minutes(epoch.latitude_deg, 2, decimals),
        "S" if epoch.latitude_deg < 0 else "N",
        _degrees_and_minutes(epoch.longitude_deg, 3, decimals),
        "W" if epoch.longitude_deg < 0 else "E",
    )


def _degrees_and_minutes(angle_deg: float, digits: int, decimals: int) -> str:
    """Return the absolute value of an angle as (d)ddmm.mmm."""
    unit = 10**decimals
    degrees, rest = divmod(round(abs(angle_deg) * 60 * unit), 60 * unit)
    minutes, fraction = divmod(rest, unit)
    return f"{degrees:0{digits}d}{minutes:02d}.{fraction:0{decimals}d}"


def _motion(epoch: Epoch) -> tuple[float, str]:
    """Return the speed in m/s, and the course in degrees clockwise from north if moving."""
    speed = math.hypot(epoch.east_mps, epoch.north_mps)
    if speed < STANDING_MPS:
        return speed, ""
    hundredths = round(math.degrees(math.atan2(epoch.east_mps, epoch.north_mps)) * 100) % 36000
    return speed, f"{hundredths / 100:.2f}"
