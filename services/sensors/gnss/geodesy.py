# SPDX-License-Identifier: Apache-2.0
"""WGS 84 conversions: geodetic coordinates, Earth-centered coordinates and a local tangent plane.

All functions are pure and take single values: plain floats in radians and meters. The Earth is the
ellipsoid, without a geoid, plate motion or other datums.
"""

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
"""Iterations of Bowring's formula. One is accurate to a micrometer at 10 km. Two are accurate to
rounding from below the ground to low orbits."""


class Geodetic(NamedTuple):
    """Geodetic coordinates of a point."""

    latitude_rad: float
    longitude_rad: float
    altitude_m: float
    """Height above the ellipsoid, along its normal."""

    @classmethod
    def of_degrees(cls, latitude_deg: float, longitude_deg: float, altitude_m: float) -> "Geodetic":
        """Return the point with these coordinates."""
        return cls(math.radians(latitude_deg), math.radians(longitude_deg), altitude_m)


def ecef_from_geodetic(place: Geodetic) -> Vector3:
    """Return x, y, z in meters: x through the Greenwich meridian, z through the north pole.

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
    """Return the geodetic coordinates of an Earth-centered position.

    The position must be at least some kilometers from the center. Bowring (1976), "Transformation
    from spatial to geographical coordinates": the latitude from the parametric latitude, iterated.
    The altitude is p cos + z sin - a sqrt(1 - e^2 sin^2), where p is the distance from the axis.
    Unlike p / cos - N, this form holds at the poles.
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
    """Local tangent plane with axes east, north and up: the axes of a world."""

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
        """Return the Earth-centered position of a point in the plane's frame."""
        x, y, z = self.turned(enu_m)
        return x + self._origin[0], y + self._origin[1], z + self._origin[2]

    def turned(self, enu: Vector3) -> Vector3:
        """Rotate a vector from the plane's frame into Earth-centered axes."""
        (xe, xn, xu), (ye, yn, yu), (ze, zn, zu) = self._ecef_from_enu
        east, north, up = enu
        return (
            xe * east + xn * north + xu * up,
            ye * east + yn * north + yu * up,
            ze * east + zn * north + zu * up,
        )
