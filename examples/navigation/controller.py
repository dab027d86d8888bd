# SPDX-License-Identifier: Apache-2.0
"""Controller: regulated pure pursuit for robots that turn on the spot."""

from dataclasses import dataclass

import numpy as np
from poses import Floats, inverse, transformed, wrapped


@dataclass(frozen=True, kw_only=True)
class PurePursuit:
    """Follows a path and turns to the goal's yaw at its end."""

    speed_mps: float = 0.8
    turn_radps: float = 1.0
    """Largest turn rate."""

    lookahead_m: float = 0.6
    deceleration_mps2: float = 0.4
    lateral_mps2: float = 0.4
    """Largest lateral acceleration in curves."""

    arrived_m: float = 0.05
    arrived_rad: float = 0.05
    front_m: float = 0.5
    """From the base to the robot's front."""

    half_width_m: float = 0.35
    margin_m: float = 0.1
    """Free space that is kept to obstacles ahead."""

    def command(self, pose: Floats, path: Floats, yaw: float, points: Floats) -> Floats | None:
        """Return the speed (m/s) and turn rate (rad/s); None at the goal.

        Parameters
        ----------
        pose
            map_from_base.
        path
            points in the map, shape (N, 2), of which the last is the goal.
        yaw
            of the goal.
        points
            of the newest scan, in the base frame, shape (N, 2).
        """
        left_m = float(np.hypot(*(path[-1] - pose[:2])))
        if left_m < self.arrived_m:
            turn = wrapped(yaw - pose[2])
            return None if abs(turn) < self.arrived_rad else np.array([0.0, self._turn(turn)])
        x, y = self._target(pose, path)
        bearing = float(np.arctan2(y, x))
        if abs(bearing) > 0.8:
            return np.array([0.0, self._turn(bearing)])
        curvature = 2 * y / (x * x + y * y)
        speed_mps = min(
            self.speed_mps,
            np.sqrt(2 * self.deceleration_mps2 * left_m),
            np.sqrt(self.lateral_mps2 / max(abs(curvature), 1e-3)),
            np.sqrt(2 * self.deceleration_mps2 * self._free_m(points)),
        )
        if speed_mps < 0.05:  # an obstacle ahead: turn toward the path, which leads around it
            return np.array([0.0, self._turn(bearing)])
        turn = np.clip(speed_mps * curvature, -self.turn_radps, self.turn_radps)
        return np.array([speed_mps, turn])

    def _target(self, pose: Floats, path: Floats) -> Floats:
        """Return the point of the path to steer to, in the base frame."""
        ahead = path[np.argmin(np.hypot(*(path - pose[:2]).T)) :]
        distances_m = np.hypot(*(ahead - pose[:2]).T)
        index = np.argmax(distances_m >= self.lookahead_m)
        target = ahead[index] if distances_m[index] >= self.lookahead_m else path[-1]
        return transformed(inverse(pose), target[None])[0]

    def _turn(self, angle: float) -> float:
        return float(np.clip(1.5 * angle, -self.turn_radps, self.turn_radps))

    def _free_m(self, points: Floats) -> float:
        """Return how far the robot can drive straight ahead."""
        beside = np.abs(points[:, 1]) < self.half_width_m + self.margin_m
        ahead = points[beside & (points[:, 0] > 0), 0]
        return max(float(np.min(ahead, initial=np.inf)) - self.front_m - self.margin_m, 0.0)
