# SPDX-License-Identifier: Apache-2.0
"""Fault effects on a laser scan: range offset and covered sector."""

import numpy as np
from msgspec.structs import replace

from groundlink.messages.base import packed
from groundlink.messages.imagery import LaserScan
from services.sensors.faults.offsets import Offsets, within, within_limits


def offset_range(scan: LaserScan, offsets: Offsets) -> LaserScan:
    """Add an offset to all ranges."""
    range_m = np.frombuffer(scan.ranges_m, np.float32).astype(np.float64)
    range_m = within_limits(
        range_m + offsets(len(range_m), 1)[:, 0], scan.min_range_m, scan.max_range_m
    )
    return replace(scan, ranges_m=packed(range_m.astype(np.float32)))


def cover(scan: LaserScan, begin_rad: float, width_rad: float) -> LaserScan:
    """Remove all returns from a sector."""
    range_m = np.frombuffer(scan.ranges_m, np.float32)
    azimuth = scan.angle_min_rad + scan.angle_increment_rad * np.arange(len(range_m))
    covered = within(azimuth, begin_rad, width_rad)
    range_m = np.where(covered, np.float32(np.inf), range_m)
    if not len(scan.intensities):
        return replace(scan, ranges_m=packed(range_m))
    shine = np.where(covered, np.float32(0), np.frombuffer(scan.intensities, np.float32))
    return replace(scan, ranges_m=packed(range_m), intensities=packed(shine))
