# SPDX-License-Identifier: Apache-2.0
"""Track, speed and commands of a vehicle, thinned to what a figure shows.

In long runs every n-th ground-truth message is decoded, so the distance may be slightly short.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .sensors import heading

MAX_POINTS = 20_000
"""Maximum points of a trajectory: 400 s at 50 Hz."""


@dataclass
class VehicleMotion:
    """The trajectory of one vehicle."""

    vehicle: str
    stride: int
    """Every n-th message is decoded."""

    rows: list[tuple[float, float, float, float, float, float]] = field(default_factory=list)
    """Time (s of the run), x, y (m, world), speed (m/s, ahead positive), yaw rate (rad/s), heading
    (rad)."""

    asked: list[tuple[float, float, float]] = field(default_factory=list)
    """Time (s of the run), speed (m/s) and yaw rate (rad/s) of commands."""

    def moved(self, seconds: float, odometry: Any) -> None:
        """Take a nav_msgs/Odometry of the ground truth."""
        pose, twist = odometry.pose.pose, odometry.twist.twist
        place, turn = pose.position, heading(pose.orientation)
        self.rows.append((seconds, place.x, place.y, twist.linear.x, twist.angular.z, turn))

    def was_asked(self, seconds: float, twist: Any) -> None:
        """Take a geometry_msgs/Twist."""
        self.asked.append((seconds, twist.linear.x, twist.angular.z))

    def track(self) -> NDArray[np.float64]:
        """Return `rows` as an array, shape (N, 6)."""
        return np.array(self.rows, np.float64).reshape(-1, 6)

    @property
    def distance_m(self) -> float:
        """Length of the path."""
        track = self.track()
        return float(np.linalg.norm(np.diff(track[:, 1:3], axis=0), axis=1).sum())

    def place(self, seconds: float) -> tuple[float, float] | None:
        """Return x, y at a time; None without data."""
        track = self.track()
        if not len(track):
            return None
        x, y = (float(np.interp(seconds, track[:, 0], track[:, i])) for i in (1, 2))
        return x, y

    @property
    def top_speed_mps(self) -> float:
        """The largest speed, ahead or back."""
        return max((abs(row[3]) for row in self.rows), default=0.0)


def stride(messages: int) -> int:
    """Return n such that every n-th message is decoded."""
    return max(-(-messages // MAX_POINTS), 1)
