# SPDX-License-Identifier: Apache-2.0
"""Dead reckoning of a differentially steered vehicle, with covariance.

The input is the travel of the two sides, the output a pose with its covariance. This module is
independent of wheels, ticks and ground truth. A step is an arc, whose midpoint gives the direction.
The covariance is propagated to first order and has two parts. White errors of the two travels are
independent and grow with the root of the distance (K. S. Chong and L. Kleeman, "Accurate Odometry
and Error Modelling for a Mobile Robot", ICRA 1997). The unknown constants of a run are the scale of
each side, the scale of the effective track, and the velocities along and sideways with which the
vehicle skids per m/s^2 of lateral acceleration. The derivatives of the pose by these constants are
summed along the path.
"""

import math
from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class Reckoned(msgspec.Struct, array_like=True):
    """Pose in the frame of the first step, with its uncertainty."""

    x_m: float = 0.0
    y_m: float = 0.0
    yaw_rad: float = 0.0
    white: list[list[float]] = msgspec.field(default_factory=lambda: np.zeros((3, 3)).tolist())
    """Covariance of x, y (m) and yaw (rad) from white errors, 3 x 3."""

    by_constants: list[list[float]] = msgspec.field(
        default_factory=lambda: np.zeros((3, 5)).tolist()
    )
    """Derivatives of x, y and yaw by the scales of left, right and track (relative) and by the skid
    along and sideways (s), 3 x 5."""


class Reckoning:
    """Integrator of steps.

    Parameters
    ----------
    track_m
        Effective track: difference between the travels of the two sides per radian of turn.
    travel_stddevs
        Standard deviations of the left and the right travel after a meter, m.
    constant_stddevs
        Standard deviations of the scales of left, right and track (relative) and of the skid along
        and sideways (s).
    """

    def __init__(
        self,
        *,
        track_m: float,
        travel_stddevs: Sequence[float],
        constant_stddevs: Sequence[float],
    ) -> None:
        self.from_sides = np.array([[0.5, 0.5], [-1 / track_m, 1 / track_m]])
        """Matrix from the travels of left and right to distance and turn, 2 x 2."""

        self._track_m = track_m
        self._travel_variances = np.square(travel_stddevs)
        self._constants = np.diag(np.square(constant_stddevs))
        self.pose = Reckoned()

    def origin(self) -> Reckoned:
        """Return the pose before the first step."""
        return Reckoned()

    def covariance(self) -> Floats:
        """Return the pose's covariance of x, y (m) and yaw (rad), 3 x 3."""
        by_constants = np.array(self.pose.by_constants)
        covariance: Floats = by_constants @ self._constants @ by_constants.T
        return covariance + self.pose.white

    def step(self, left_m: float, right_m: float, seconds: float) -> tuple[float, float, Floats]:
        """Advance the pose by the travels of both sides in a time.

        Returns
        -------
        The distance of the midpoint (m), the turn (rad) and the covariance of these two, 2 x 2.
        """
        way, turn = (left_m + right_m) / 2, (right_m - left_m) / self._track_m
        white = self._travel_variances * [abs(left_m), abs(right_m)]
        spread = self.from_sides * white @ self.from_sides.T
        scaled = np.column_stack([self.from_sides * [left_m, right_m], [0.0, turn]])

        pose = self.pose
        middle = pose.yaw_rad + turn / 2
        along, across = math.cos(middle), math.sin(middle)
        carried = np.array([[1, 0, -way * across], [0, 1, way * along], [0, 0, 1]])
        added = np.array([[along, -way / 2 * across], [across, way / 2 * along], [0, 1]])
        covariance = carried @ np.array(pose.white) @ carried.T + added @ spread @ added.T
        skid = way * turn / seconds
        by_constants = carried @ np.array(pose.by_constants) + np.column_stack(
            [
                added @ scaled,
                [along * abs(skid), across * abs(skid), 0.0],
                [-across * skid, along * skid, 0.0],
            ]
        )
        self.pose = Reckoned(
            x_m=pose.x_m + way * along,
            y_m=pose.y_m + way * across,
            yaw_rad=math.remainder(pose.yaw_rad + turn, 2 * math.pi),
            white=((covariance + covariance.T) / 2).tolist(),
            by_constants=by_constants.tolist(),
        )
        return way, turn, spread + scaled @ self._constants[:3, :3] @ scaled.T
