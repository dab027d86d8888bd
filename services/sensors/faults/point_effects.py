# SPDX-License-Identifier: Apache-2.0
"""Fault effects on points of a LiDAR or a radar: range offset and covered sector."""

from typing import TypeVar

import numpy as np
from msgspec.structs import replace

from groundlink.messages.base import PointCloud, packed
from groundlink.messages.imagery import RadarDetections

from .offsets import Offsets, within

Points = TypeVar("Points", PointCloud, RadarDetections)


def offset_range(cloud: Points, offsets: Offsets) -> Points:
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


def cover(cloud: Points, begin_rad: float, width_rad: float) -> Points:
    """Remove the points of a sector."""
    points = cloud.records()
    azimuth = np.arctan2(points["y"], points["x"], dtype=np.float64)
    return replace(cloud, points=packed(points[~within(azimuth, begin_rad, width_rad)]))
