# SPDX-License-Identifier: Apache-2.0
"""Track, speed and commands of a vehicle, thinned to what a figure shows; its passages.

In long runs every n-th ground-truth message is decoded, so the distance may be slightly short.
"""

from collections.abc import Mapping
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


NEAR_M = 1.0


@dataclass(frozen=True)
class Passage:
    """One passage of a vehicle."""

    checkpoint: str
    seconds: float
    """Sim time."""

    apart_m: float
    """Horizontal distance from the checkpoint to the vehicle's base."""


def passages(
    track: NDArray[np.float64], checkpoints_m: Mapping[str, tuple[float, float]]
) -> list[Passage]:
    """Return all passages, the earliest first.

    Each time a track comes within `NEAR_M` of a checkpoint and leaves again is one passage, at the
    moment of the least distance.

    Parameters
    ----------
    track
        Shape (N, 3 or more): time, x, y, as `Motion.track`.
    checkpoints_m
        x and y by name, in the world.
    """
    found = []
    for name, place in checkpoints_m.items():
        apart = np.hypot(*(track[:, 1:3] - place).T)
        near = np.concatenate([[False], apart < NEAR_M, [False]])
        begins, ends = np.flatnonzero(near[1:] != near[:-1]).reshape(-1, 2).T
        for begin, end in zip(begins, ends, strict=True):
            row = begin + int(apart[begin:end].argmin())
            found.append(Passage(name, float(track[row, 0]), float(apart[row])))
    return sorted(found, key=lambda passage: passage.seconds)
