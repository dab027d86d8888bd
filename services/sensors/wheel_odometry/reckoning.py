# SPDX-License-Identifier: Apache-2.0
"""Dead reckoning of a vehicle that is steered by the difference of its sides.

Rule: travels of the two sides in, a pose with its covariance out; nothing here knows wheels, ticks
or truth. A step is an arc, of which the middle gives the direction. The covariance is carried on to
the first order, with errors of the two travels that are independent and grow with the root of the
way (K. S. Chong and L. Kleeman, "Accurate Odometry and Error Modelling for a Mobile Robot", ICRA
1997), and one of the heading that grows with the root of the angle turned: what a vehicle that
skids round cannot know.
"""

from __future__ import annotations

import math

import msgspec
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class Reckoned(msgspec.Struct, array_like=True):
    """A pose in the frame in which counting began, and how sure it is."""

    x_m: float = 0.0
    y_m: float = 0.0
    yaw_rad: float = 0.0
    covariance: list[list[float]] = msgspec.field(default_factory=lambda: np.zeros((3, 3)).tolist())
    """3 x 3, of x, y (m) and yaw (rad)."""


class Reckoning:
    """Adds up steps.

    Parameters
    ----------
    track_m
        Effective: by how much more one side travels than the other in a turn of a radian.
    travel_stddev, turn_stddev
        As in the scenario's `wheel_odometry`.
    """

    def __init__(self, *, track_m: float, travel_stddev: float, turn_stddev: float) -> None:
        self.from_sides = np.array([[0.5, 0.5], [-1 / track_m, 1 / track_m]])
        """From the travels of left and right to way and turn, 2 x 2."""

        self._track_m = track_m
        self._travel_variance = travel_stddev**2
        self._turn_variance = turn_stddev**2
        self.pose = Reckoned()

    def step(self, left_m: float, right_m: float) -> tuple[float, float, Floats]:
        """Go on by the travels of both sides.

        Returns
        -------
        The way of the middle (m), the angle turned (rad) and the covariance of these two, 2 x 2.
        """
        way, turn = (left_m + right_m) / 2, (right_m - left_m) / self._track_m
        spread = self.from_sides * [abs(left_m), abs(right_m)] @ self.from_sides.T
        spread *= self._travel_variance
        spread[1, 1] += self._turn_variance * abs(turn)

        pose = self.pose
        middle = pose.yaw_rad + turn / 2
        along, across = math.cos(middle), math.sin(middle)
        carried = np.array([[1, 0, -way * across], [0, 1, way * along], [0, 0, 1]])
        added = np.array([[along, -way / 2 * across], [across, way / 2 * along], [0, 1]])
        covariance = carried @ np.array(pose.covariance) @ carried.T + added @ spread @ added.T
        self.pose = Reckoned(
            x_m=pose.x_m + way * along,
            y_m=pose.y_m + way * across,
            yaw_rad=math.remainder(pose.yaw_rad + turn, 2 * math.pi),
            covariance=((covariance + covariance.T) / 2).tolist(),
        )
        return way, turn, spread
