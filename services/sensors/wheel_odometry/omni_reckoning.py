# SPDX-License-Identifier: Apache-2.0
"""Dead reckoning of a base that moves in all directions, with covariance.

The input is the turn of each wheel, the output a pose with its covariance, as in `reckoning`. A
step is the velocity that the wheels' turns amount to in least squares; the heading in its middle
gives its direction. Unknown constants of a run are the scale of each wheel and that of the turn.
"""

import math
from collections.abc import Sequence

import numpy as np

from .reckoning import Floats, Reckoned


class OmniReckoning:
    """Integrator of steps.

    Parameters
    ----------
    rows
        turn of each wheel (rad) for 1 m along x, 1 m along y and 1 rad, shape (wheels, 3).
    radii_m
        of the wheels.
    travel_stddevs
        standard deviations of the travel of each wheel's rim after a meter, m.
    constant_stddevs
        relative standard deviations of the scale of each wheel, and of the turn.
    """

    def __init__(
        self,
        rows: Floats,
        radii_m: Sequence[float],
        *,
        travel_stddevs: Sequence[float],
        constant_stddevs: Sequence[float],
    ) -> None:
        self.from_wheels: Floats = np.linalg.pinv(rows).astype(np.float64)
        """Matrix from the wheels' turns to the way along x and y (m) and the turn (rad)."""

        self._radii_m = np.array(radii_m)
        self._travel_variances = np.square(travel_stddevs)
        self._constants = np.diag(np.square(constant_stddevs))
        self.pose = self.origin()

    def origin(self) -> Reckoned:
        """Return the pose before the first step."""
        return Reckoned(by_constants=np.zeros((3, len(self._constants))).tolist())

    def covariance(self) -> Floats:
        """Return the pose's covariance of x, y (m) and yaw (rad), 3 x 3."""
        by_constants = np.array(self.pose.by_constants)
        covariance: Floats = by_constants @ self._constants @ by_constants.T
        return covariance + self.pose.white

    def step(self, turned_rad: Floats) -> tuple[Floats, Floats]:
        """Advance the pose by the turns of the wheels.

        Returns
        -------
        The way along x and y (m) and the turn (rad), shape (3,), and their covariance, 3 x 3.
        """
        moved: Floats = self.from_wheels @ turned_rad
        ways_m = self._radii_m * np.abs(turned_rad)
        white = self._travel_variances * ways_m / self._radii_m**2
        spread = self.from_wheels * white @ self.from_wheels.T
        scaled = np.column_stack([self.from_wheels * turned_rad, [0.0, 0.0, moved[2]]])

        pose, (forward, left, turn) = self.pose, moved.tolist()
        middle = pose.yaw_rad + turn / 2
        c, s = math.cos(middle), math.sin(middle)
        x, y = c * forward - s * left, s * forward + c * left
        carried = np.array([[1, 0, -y], [0, 1, x], [0, 0, 1]])
        added = np.array([[c, -s, -y / 2], [s, c, x / 2], [0, 0, 1]])
        covariance = carried @ np.array(pose.white) @ carried.T + added @ spread @ added.T
        by_constants = carried @ np.array(pose.by_constants) + added @ scaled
        self.pose = Reckoned(
            x_m=pose.x_m + x,
            y_m=pose.y_m + y,
            yaw_rad=math.remainder(pose.yaw_rad + turn, 2 * math.pi),
            white=((covariance + covariance.T) / 2).tolist(),
            by_constants=by_constants.tolist(),
        )
        return moved, spread + scaled @ self._constants @ scaled.T
