# SPDX-License-Identifier: Apache-2.0
"""Planar scans and single ranges."""

from typing import Any, NamedTuple

import numpy as np

from .base import Floats, Samples, TopicReadings


class ScanHeader(NamedTuple):
    """Numbers of a sensor_msgs/LaserScan."""

    angle_min: float
    angle_max: float
    angle_increment: float
    time_increment: float
    scan_time: float
    range_min: float
    range_max: float
    ranges: int
    intensities: int


class ScanReadings(TopicReadings):
    """Readings of sensor_msgs/LaserScan."""

    types = ("sensor_msgs/msg/LaserScan",)

    def prepare(self) -> None:
        """Create the lists."""
        self.headers: list[ScanHeader] = []
        self.scans: Samples[Floats] = Samples(most=200)
        """Ranges in meters."""
        self._profiles: list[Floats] = []

    def take(self, index: int, message: Any) -> None:
        """Take the header; keep some scans."""
        ranges = np.asarray(message.ranges, np.float64)
        self.headers.append(
            ScanHeader(
                float(message.angle_min),
                float(message.angle_max),
                float(message.angle_increment),
                float(message.time_increment),
                float(message.scan_time),
                float(message.range_min),
                float(message.range_max),
                len(ranges),
                len(message.intensities),
            )
        )
        first = self.headers[0]
        self._profiles.append(
            np.where(np.isfinite(ranges), ranges, np.nan)
            if len(ranges) == first.ranges
            else np.full(first.ranges, np.nan)
        )
        if self.scans.wants(index):
            self.scans.keep(index, ranges)

    def finish(self) -> None:
        """Make the arrays."""
        self.profiles: Floats = np.array(self._profiles, np.float64)
        """Ranges of all scans that have as many as the first; NaN where there is no return."""


class RangeReadings(TopicReadings):
    """Readings of sensor_msgs/Range."""

    types = ("sensor_msgs/msg/Range",)

    def prepare(self) -> None:
        """Create the lists."""
        self._rows: list[tuple[float, ...]] = []

    def take(self, index: int, message: Any) -> None:
        """Take the numbers."""
        self._rows.append(
            (
                message.range,
                message.min_range,
                message.max_range,
                message.field_of_view,
                message.radiation_type,
            )
        )

    def finish(self) -> None:
        """Make the arrays: meters, radians."""
        rows = np.array(self._rows, np.float64).reshape(-1, 5)
        self.ranges, self.min_range, self.max_range = rows[:, 0], rows[:, 1], rows[:, 2]
        self.field_of_view, self.radiation_type = rows[:, 3], rows[:, 4]
