# SPDX-License-Identifier: Apache-2.0
"""Wall-following controller from scan and odometry, independent of any middleware.

Decisions depend on stamps, never on the order of arrival. Each odometry message is paired with the
newest scan that is at least `AGE_NANOS` old, and the controller waits for that scan. Numbers are
Python floats from the fields of ROS messages, so every middleware gives the same bits. This module
imports neither ROS nor the bus.
"""

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

AGE_NANOS = 200_000_000
PERIOD_NANOS = 100_000_000
"""Of scans; the first is of time 0."""

SPEED_MPS, TURN_RADPS = 0.7, 1.2
WALL_M, AHEAD_M = 1.0, 1.3


class Scan(NamedTuple):
    """A planar scan: angles in rad, counterclockwise from the front; ranges in meters."""

    stamp_nanos: int
    first_rad: float
    step_rad: float
    ranges_m: Sequence[float]

    def nearest(self, from_deg: float, to_deg: float) -> float:
        """Return the shortest range between two angles; 10 m where there is none."""
        low, high = math.radians(from_deg), math.radians(to_deg)
        found = 10.0
        for i, range_m in enumerate(self.ranges_m):
            angle = math.remainder(self.first_rad + i * self.step_rad, 2 * math.pi)
            if low <= angle <= high and 0.05 < range_m < found:
                found = range_m
        return found


class WallFollower:
    """Decides; ends after so many laps, which odometry counts by its turns to the left."""

    def __init__(self, laps: int) -> None:
        self.laps = laps
        self.turned_rad = 0.0
        self._scans: deque[Scan] = deque(maxlen=32)
        self._waiting: deque[tuple[int, float]] = deque()
        self._yaw: float | None = None

    def scan(self, scan: Scan) -> None:
        """Take a scan."""
        self._scans.append(scan)

    def odometry(self, stamp_nanos: int, z: float, w: float) -> None:
        """Take a pose: z and w of a quaternion that turns about z."""
        self._waiting.append((stamp_nanos, 2 * math.atan2(z, w)))

    def decisions(self) -> list[tuple[float, float]]:
        """Return forward and yaw speed (m/s, rad/s) for each odometry whose scan is there."""
        decided = []
        while self._waiting:
            stamp_nanos, yaw = self._waiting[0]
            due = stamp_nanos - AGE_NANOS
            fit = [s for s in self._scans if due - PERIOD_NANOS < s.stamp_nanos <= due]
            if due >= 0 and not fit:
                break
            self._waiting.popleft()
            decided.append(self._decide(yaw, fit[-1]) if due >= 0 else (0.0, 0.0))
        return decided

    def _decide(self, yaw: float, scan: Scan) -> tuple[float, float]:
        if self._yaw is not None:
            self.turned_rad += math.remainder(yaw - self._yaw, 2 * math.pi)
        self._yaw = yaw
        if self.turned_rad > 2 * math.pi * self.laps:
            return 0.0, 0.0
        ahead = scan.nearest(-25, 25)
        before, behind = scan.nearest(-75, -55), scan.nearest(-125, -105)
        if ahead < AHEAD_M:
            return 0.15, TURN_RADPS
        beside = 0.5 * (min(before, 2.5) + min(behind, 2.5)) * math.sin(math.radians(65))
        steer = 0.8 * (WALL_M - beside) + 0.7 * (min(behind, 2.5) - min(before, 2.5))
        return SPEED_MPS, max(-TURN_RADPS, min(TURN_RADPS, steer))
