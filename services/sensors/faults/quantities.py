# SPDX-License-Identifier: Apache-2.0
"""What the numbers of a reading are, for those who make them wrong: one table for all messages.

Rule: a reading and offsets in, another reading out; what is added is somebody else's business. The
names are those of `SensorSpec.quantities`. A value that is none (NaN, infinite) stays as it is, and
a range that leaves the device's limits becomes what the device says there. Covariances stay, since
a device that is broken does not know it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from msgspec.structs import replace

from groundlink.core.fields import Vector3
from groundlink.core.frames import Floats
from groundlink.messages.base import Imu, PointCloud, Reading, WheelEncoders, packed
from groundlink.messages.imagery import CameraInfo, CompressedImage, Image, LaserScan, Range
from groundlink.messages.navigation import NavSatFix, Odometry
from services.sensors.runtime.wheel_counters import wrapped

Offsets = Callable[[int, int], Floats]
"""From numbers of measurements and of components to what is added, in this shape."""

WGS84_RADIUS_M = 6378137.0
WGS84_ECCENTRICITY_SQUARED = 6.69437999014e-3
"""Of the ellipsoid (NIMA TR8350.2, table 3.3)."""


def _sum(vector: Vector3, offsets: Offsets) -> Vector3:
    x, y, z = (np.array(vector) + offsets(1, 3)[0]).tolist()
    return x, y, z


def _acceleration(imu: Imu, offsets: Offsets) -> Imu:
    felt = _sum(imu.linear_acceleration_mps2, offsets)
    return replace(imu, linear_acceleration_mps2=felt)


def _angular_velocity(imu: Imu, offsets: Offsets) -> Imu:
    return replace(imu, angular_velocity_radps=_sum(imu.angular_velocity_radps, offsets))


def _cloud_range(cloud: PointCloud, offsets: Offsets) -> PointCloud:
    """Move points along the line from the sensor's origin; what comes behind it is gone."""
    points = cloud.records()
    range_m = np.sqrt(sum(points[axis].astype(np.float64) ** 2 for axis in "xyz"))
    moved_m = range_m + offsets(len(points), 1)[:, 0]
    left = (moved_m > 0) & (range_m > 0)
    points = points[left].copy()
    scale = moved_m[left] / range_m[left]
    for axis in "xyz":
        points[axis] = points[axis] * scale
    return replace(cloud, points=packed(points))


def _reported(range_m: Floats, least_m: float, most_m: float) -> Floats:
    """Return distances as a device with limits says them (REP 117)."""
    finite = np.isfinite(range_m)
    told = np.where(finite & (range_m > most_m), np.inf, range_m)
    return np.where(finite & (range_m < least_m), -np.inf, told)


def _scan_range(scan: LaserScan, offsets: Offsets) -> LaserScan:
    range_m = np.frombuffer(scan.ranges_m, np.float32).astype(np.float64)
    range_m = _reported(
        range_m + offsets(len(range_m), 1)[:, 0], scan.min_range_m, scan.max_range_m
    )
    return replace(scan, ranges_m=packed(range_m.astype(np.float32)))


def _range(reading: Range, offsets: Offsets) -> Range:
    range_m = np.array([reading.range_m]) + offsets(1, 1)[0]
    [told] = _reported(range_m, reading.min_range_m, reading.max_range_m).tolist()
    return replace(reading, range_m=told)


def _ticks(reading: WheelEncoders, offsets: Offsets) -> WheelEncoders:
    more = np.rint(offsets(1, len(reading.ticks))[0]).tolist()
    ticks = tuple(wrapped(t + int(m)) for t, m in zip(reading.ticks, more, strict=True))
    return replace(reading, ticks=ticks)


def _fix_position(fix: NavSatFix, offsets: Offsets) -> NavSatFix:
    """Move a fix along east, north and up, to the first order of the way.

    By the radii of curvature of the ellipsoid in the meridian and the prime vertical (Torge and
    Müller 2012, "Geodesy", 4.1.3).
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


def _position(odometry: Odometry, offsets: Offsets) -> Odometry:
    return replace(odometry, position_m=_sum(odometry.position_m, offsets))


def _yaw(odometry: Odometry, offsets: Offsets) -> Odometry:
    """Turn the pose about the frame's z."""
    half = float(offsets(1, 1)[0, 0]) / 2
    s, c = math.sin(half), math.cos(half)
    x, y, z, w = odometry.orientation
    turned = (c * x - s * y, c * y + s * x, c * z + s * w, c * w - s * z)
    return replace(odometry, orientation=turned)


QUANTITIES: dict[type[Reading], dict[str, Callable[[Any, Offsets], Any]]] = {
    PointCloud: {"range": _cloud_range},
    LaserScan: {"range": _scan_range},
    Imu: {"acceleration": _acceleration, "angular_velocity": _angular_velocity},
    WheelEncoders: {"ticks": _ticks},
    Odometry: {"position": _position, "yaw": _yaw},
    NavSatFix: {"position": _fix_position},
    Range: {"range": _range},
    CompressedImage: {},
    Image: {},
    CameraInfo: {},
}
"""By message and quantity: the reading with offsets added; the first is meant unless named."""
