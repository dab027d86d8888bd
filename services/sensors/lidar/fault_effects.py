# SPDX-License-Identifier: Apache-2.0
"""Fault effects on a point cloud: range offset and covered sector."""

import numpy as np
from msgspec.structs import replace

from groundlink.messages.base import PointCloud, packed
from services.sensors.faults.offsets import Offsets, within


def offset_range(cloud: PointCloud, offsets: Offsets) -> PointCloud:
    """Move points along the line from the sensor's origin; remove points that move behind it."""
    points = cloud.records()
    range_m = np.sqrt(sum(points[axis].astype(np.float64) ** 2 for axis in "xyz"))
    moved_m = range_m + offsets(len(points), 1)[:, 0]
    left = (moved_m > 0) & (range_m > 0)
    points = points[left].copy()
    scale = moved_m[left] / range_m[left]
    for axis in "xyz":
        points[axis] = points[axis] * scale
    return replace(cloud, points=packed(points))


def cover(cloud: PointCloud, begin_rad: float, width_rad: float) -> PointCloud:
    """Remove the points of a sector."""
    points = cloud.records()
    azimuth = np.arctan2(points["y"], points["x"], dtype=np.float64)
    return replace(cloud, points=packed(points[~within(azimuth, begin_rad, width_rad)]))
