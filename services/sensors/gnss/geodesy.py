# SPDX-License-Identifier: Apache-2.0
"""WGS 84: geodetic coordinates, Earth-centred ones and a local tangent plane.

Rule: single values in plain floats, radians and metres; pure functions. The Earth is the ellipsoid:
no geoid, no plate motion, no other datum.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from groundlink.core.fields import Vector3

SEMI_MAJOR_AXIS_M = 6378137.0
"""a: NGA.STND.0036, WGS 84, table 3.1."""

FLATTENING = 1 / 298.257223563
"""f: the same table."""

SEMI_MINOR_AXIS_M = SEMI_MAJOR_AXIS_M * (1 - FLATTENING)
ECCENTRICITY_SQUARED = FLATTENING * (2 - FLATTENING)
SECOND_ECCENTRICITY_SQUARED = ECCENTRICITY_SQUARED / (1 - ECCENTRICITY_SQUARED)

_ITERATIONS = 2
"""Of Bowring's formula; one is good to a micrometre at 10 km, two to rounding from below the ground
to low orbits."""


class Geodetic(NamedTuple):
    """A place on or above the ellipsoid."""

    latitude_rad: float
    longitude_rad: float
    altitude_m: float
    """Above the ellipsoid, along its normal."""

    @classmethod
    def of_degrees(cls, latitude_deg: float, longitude_deg: float, altitude_m: float) -> Geodetic:
        """Return the place with these coordinates."""
        return cls(math.radians(latitude_deg), math.radians(longitude_deg), altitude_m)


def ecef_from_geodetic(place: Geodetic) -> Vector3:
    """Return x, y, z in metres: x through the Greenwich meridian, z through the north pole.

    The closed form with the radius of curvature in the prime vertical, N = a / sqrt(1 - e^2 sin^2);
    Hofmann-Wellenhof, Lichtenegger, Wasle, "GNSS" (2008), section 8.2.2.
    """
    latitude, longitude, altitude = place
    sine, cosine = math.sin(latitude), math.cos(latitude)
    normal = SEMI_MAJOR_AXIS_M / math.sqrt(1 - ECCENTRICITY_SQUARED * sine * sine)
    across = (normal + altitude) * cosine
    return (
        across * math.cos(longitude),
        across * math.sin(longitude),
        (normal * (1 - ECCENTRICITY_SQUARED) + altitude) * sine,
    )


def geodetic_from_ecef(position_m: Vector3) -> Geodetic:
    """Return the place of an Earth-centred position, at least some kilometres from the centre.

    Bowring (1976), "Transformation from spatial to geographical coordinates": the latitude from the
    parametric latitude, iterated. The altitude by p cos + z sin - a sqrt(1 - e^2 sin^2), where p is
    the distance from the axis: unlike p / cos - N it holds at the poles.
    """
    x, y, z = position_m
    across = math.hypot(x, y)
    parametric = math.atan2(SEMI_MAJOR_AXIS_M * z, SEMI_MINOR_AXIS_M * across)
    latitude = parametric
    for _ in range(_ITERATIONS):
        latitude = math.atan2(
            z + SECOND_ECCENTRICITY_SQUARED * SEMI_MINOR_AXIS_M * math.sin(parametric) ** 3,
            across - ECCENTRICITY_SQUARED * SEMI_MAJOR_AXIS_M * math.cos(parametric) ** 3,
        )
        parametric = math.atan2(
            SEMI_MINOR_AXIS_M * math.sin(latitude), SEMI_MAJOR_AXIS_M * math.cos(latitude)
        )
    sine, cosine = math.sin(latitude), math.cos(latitude)
    surface = SEMI_MAJOR_AXIS_M * math.sqrt(1 - ECCENTRICITY_SQUARED * sine * sine)
    return Geodetic(latitude, math.atan2(y, x), across * cosine + z * sine - surface)


class TangentPlane:
    """East, north and up at one place of the Earth: a world's axes."""

    def __init__(self, origin: Geodetic) -> None:
        self._origin = ecef_from_geodetic(origin)
        sine, cosine = math.sin(origin.latitude_rad), math.cos(origin.latitude_rad)
        sine_east, cosine_east = math.sin(origin.longitude_rad), math.cos(origin.longitude_rad)
        self._ecef_from_enu = (
            (-sine_east, -sine * cosine_east, cosine * cosine_east),
            (cosine_east, -sine * sine_east, cosine * sine_east),
            (0.0, cosine, sine),
        )

    def ecef(self, enu_m: Vector3) -> Vector3:
        """Return the Earth-centred position of a point of the plane's frame."""
        x, y, z = self.turned(enu_m)
        return x + self._origin[0], y + self._origin[1], z + self._origin[2]

    def turned(self, enu: Vector3) -> Vector3:
        """Return a vector of the plane's frame in Earth-centred axes."""
        (xe, xn, xu), (ye, yn, yu), (ze, zn, zu) = self._ecef_from_enu
        east, north, up = enu
        return (
            xe * east + xn * north + xu * up,
            ye * east + yn * north + yu * up,
            ze * east + zn * north + zu * up,
        )
