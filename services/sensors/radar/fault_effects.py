# SPDX-License-Identifier: Apache-2.0
"""Fault effect on radar detections: offset of the radial velocity."""

from msgspec.structs import replace

from groundlink.messages.base import packed
from groundlink.messages.imagery import RadarDetections
from services.sensors.faults.offsets import Offsets


def offset_velocity(frame: RadarDetections, offsets: Offsets) -> RadarDetections:
    """Add an offset to the radial velocities."""
    points = frame.records().copy()
    points["velocity"] = points["velocity"] + offsets(len(points), 1)[:, 0]
    return replace(frame, points=packed(points))
