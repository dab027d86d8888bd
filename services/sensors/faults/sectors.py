# SPDX-License-Identifier: Apache-2.0
"""Readings of sensors that look around, without what returned from a sector of their turn.

Rule: a reading and a sector in, another reading out. Azimuth is that of a point as the cloud has
it, or of a scan's ray, from the sensor's x towards its y.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from groundlink.messages.base import PointCloud, Reading, packed
from groundlink.messages.imagery import LaserScan


def _within(
    azimuth_rad: NDArray[np.floating], begin_rad: float, width_rad: float
) -> NDArray[np.bool_]:
    """Return which azimuths are in the sector that goes counter-clockwise from `begin_rad`."""
    inside: NDArray[np.bool_] = (azimuth_rad - begin_rad) % (2 * math.pi) <= width_rad
    return inside


def _cover_cloud(cloud: PointCloud, begin_rad: float, width_rad: float) -> PointCloud:
    points = cloud.records()
    azimuth = np.arctan2(points["y"], points["x"], dtype=np.float64)
    return replace(cloud, points=packed(points[~_within(azimuth, begin_rad, width_rad)]))


def _cover_scan(scan: LaserScan, begin_rad: float, width_rad: float) -> LaserScan:
    range_m = np.frombuffer(scan.ranges_m, np.float32)
    azimuth = scan.angle_min_rad + scan.angle_increment_rad * np.arange(len(range_m))
    covered = _within(azimuth, begin_rad, width_rad)
    range_m = np.where(covered, np.float32(np.inf), range_m)
    if not len(scan.intensities):
        return replace(scan, ranges_m=packed(range_m))
    shine = np.where(covered, np.float32(0), np.frombuffer(scan.intensities, np.float32))
    return replace(scan, ranges_m=packed(range_m), intensities=packed(shine))


COVERED: dict[type[Reading], Callable[[Any, float, float], Any]] = {
    PointCloud: _cover_cloud,
    LaserScan: _cover_scan,
}
"""By message: the reading without what returned from a sector: its begin and width, in radians."""
