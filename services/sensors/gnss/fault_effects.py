# SPDX-License-Identifier: Apache-2.0
"""Fault effects on a GNSS fix."""

import math

from msgspec.structs import replace

from groundlink.messages.navigation import NavSatFix
from services.sensors.faults.offsets import Offsets

WGS84_RADIUS_M = 6378137.0
WGS84_ECCENTRICITY_SQUARED = 6.69437999014e-3
"""Semi-major axis and squared eccentricity of the ellipsoid (NIMA TR8350.2, table 3.3)."""


def offset_position(fix: NavSatFix, offsets: Offsets) -> NavSatFix:
    """Move a fix along east, north and up, to first order in the distance.

    Uses the ellipsoid's radii of curvature in the meridian and the prime vertical (Torge and Müller
    2012, "Geodesy", 4.1.3).
    """
    east, north, up = offsets(1, 3)[0].tolist()
    latitude = math.radians(fix.latitude_deg)
    w = 1 - WGS84_ECCENTRICITY_SQUARED * math.sin(latitude) ** 2
    across = WGS84_RADIUS_M / math.sqrt(w)
    along = across * (1 - WGS84_ECCENTRICITY_SQUARED) / w
    return replace(
        fix,
        latitude_deg=fix.latitude_deg + math.degrees(north / (along + fix.altitude_m)),
        longitude_deg=fix.longitude_deg
        + math.degrees(east / ((across + fix.altitude_m) * math.cos(latitude))),
        altitude_m=fix.altitude_m + up,
    )
