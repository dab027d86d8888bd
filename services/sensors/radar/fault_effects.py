# SPDX-License-Identifier: Apache-2.0
"""Fault effects on radar detections: offsets of range and velocity, and a covered sector."""

import numpy as np
from msgspec.structs import replace

from groundlink.messages.base import packed
from groundlink.messages.imagery import RadarDetections
from services.sensors.faults.offsets import Offsets, within


def offset_range(frame: RadarDetections, offsets: Offsets) -> RadarDetections:
    """Move detections along the line from the sensor; remove those that move behind it."""
    points = frame.records()
    range_m = np.sqrt(sum(points[axis].astype(np.float64) ** 2 for axis in "xyz"))
    moved_m = range_m + offsets(len(points), 1)[:, 0]
    left = (moved_m > 0) & (range_m > 0)
    points = points[left].copy()
    scale = moved_m[left] / range_m[left]
    for axis in "xyz":
        points[axis] = points[axis] * scale
    return replace(frame, points=packed(points))


def offset_velocity(frame: RadarDetections, offsets: Offsets) -> RadarDetections:
    """Add an offset to the radial velocities."""
    points = frame.records().copy()
    points["velocity"] = points["velocity"] + offsets(len(points), 1)[:, 0]
    return replace(frame, points=packed(points))


def cover(frame: RadarDetections, begin_rad: float, width_rad: float) -> RadarDetections:
    """Remove the detections of a sector."""
    points = frame.records()
    azimuth = np.arctan2(points["y"], points["x"], dtype=np.float64)
    return replace(frame, points=packed(points[~within(azimuth, begin_rad, width_rad)]))
