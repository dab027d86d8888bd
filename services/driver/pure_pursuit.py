# SPDX-License-Identifier: Apache-2.0
"""Pure-pursuit controller: follows a line, poses in, velocities out.

It steers along the arc to a point of the line some distance ahead (R. C. Coulter, "Implementation
of the Pure Pursuit Path Tracking Algorithm", CMU-RI-TR-92-01, 1992). At a sharp corner it stops and
turns in place; a vehicle that cannot turn in place takes the corner at its least radius. It has no
obstacle avoidance.
"""

from itertools import pairwise
from math import atan2, copysign, cos, inf, pi, sin, sqrt
from typing import NamedTuple

import numpy as np

from groundlink.episode.routes import Floats, Leg, Line

Twist = tuple[float, float]
"""Velocity along the base's x, m/s, and about its z, rad/s."""

LOOK_AHEAD_M = 0.25
LOOK_AHEAD_S = 0.3
"""Look-ahead distance, and the time by which it grows with the speed."""

CORNER_RAD = pi / 6
"""A sharper bend is a corner."""

OFF_COURSE_RAD = pi / 3
"""With a larger heading error the vehicle turns in place."""

ON_COURSE_RAD = 0.02
"""Heading error at which a turn in place ends."""

TURN_RATE_RADPS = 1.0
TURN_GAIN = 3.0
"""Yaw rate per radian of heading error, up to the rate above."""

SLOWEST_TURN_RADPS = 0.15
BRAKING_MPS2 = 0.5
"""Deceleration before corners and the end: well below the limit of the drive."""

SLOWEST_MPS = 0.05
SEARCHED_M = 1.0
"""Range ahead of the last nearest point in which the next one is searched."""


class Progress(NamedTuple):
    """Progress along the line."""

    leg: int = 0
    reached_m: float | None = None
    """Along the leg; None before the first pose."""

    turning: bool = True
    """In place."""


class PurePursuitFollower:
    """Follows one line, once.

    Parameters
    ----------
    line
        the line, in the world frame.
    least_radius_m
        least turning radius of the vehicle; with 0 it can turn in place.
    turns_radps2
        yaw acceleration of the vehicle. With a low one the look-ahead is longer and turns in place
        slow down earlier, since the vehicle would oscillate about the line.
    """

    def __init__(
        self, line: Line, *, least_radius_m: float = 0.0, turns_radps2: float = inf
    ) -> None:
        self._least_radius_m = least_radius_m
        self._look_ahead_s = max(LOOK_AHEAD_S, TURN_RATE_RADPS / turns_radps2)
        self._turn_gain = min(TURN_GAIN, turns_radps2 / TURN_RATE_RADPS)
        # With a nearer point than it can steer to, the vehicle would oscillate about the line.
        self._look_ahead_m = LOOK_AHEAD_M + least_radius_m / 2
        corner_rad = inf if least_radius_m else CORNER_RAD
        self._legs = [Leg(points, speeds) for points, speeds in _split(line, corner_rad)]
        self.progress = Progress()

    @property
    def progress(self) -> Progress:
        """The complete state; another follower of the same line can continue from it."""
        return Progress(self._leg, self._reached_m, self._turning)

    @progress.setter
    def progress(self, progress: Progress) -> None:
        self._leg, self._reached_m, self._turning = progress

    @property
    def finished(self) -> bool:
        """Whether the end of the line was reached."""
        return self._leg == len(self._legs)

    def twist(self, x_m: float, y_m: float, yaw_rad: float) -> Twist:
        """Return the commanded velocity at a pose of the base in the world frame.

        The first call starts at the nearest point of the line, the earliest of several.
        """
        place = np.array([x_m, y_m])
        if self._reached_m is None and self._legs:
            distances = [leg.nearest(place, 0.0, np.inf)[1] for leg in self._legs]
            self._leg = next(i for i, d in enumerate(distances) if d < min(distances) + 0.05)
            self._reached_m = self._legs[self._leg].nearest(place, 0.0, np.inf)[0]
        while not self.finished:
            leg = self._legs[self._leg]
            assert self._reached_m is not None
            end = self._reached_m + SEARCHED_M
            self._reached_m = leg.nearest(place, self._reached_m, end)[0]
            if self._reached_m < leg.length_m:
                return self._towards(leg, self._reached_m, place, yaw_rad)
            self._leg, self._reached_m, self._turning = self._leg + 1, 0.0, True
        return 0.0, 0.0

    def _towards(self, leg: Leg, reached_m: float, place: Floats, yaw_rad: float) -> Twist:
        speed = leg.speed_mps(reached_m)
        speed = min(speed, sqrt(2 * BRAKING_MPS2 * (leg.length_m - reached_m)))
        goal = leg.point(reached_m + self._look_ahead_m + self._look_ahead_s * speed)
        east, north = (goal - place).tolist()
        ahead = cos(yaw_rad) * east + sin(yaw_rad) * north
        left = cos(yaw_rad) * north - sin(yaw_rad) * east
        if self._least_radius_m:
            return self._arc(left, ahead, speed)
        aside_rad = atan2(left, ahead)
        self._turning = abs(aside_rad) > (ON_COURSE_RAD if self._turning else OFF_COURSE_RAD)
        if self._turning:
            rate = max(SLOWEST_TURN_RADPS, self._turn_gain * abs(aside_rad))
            rate = min(TURN_RATE_RADPS, rate)
            return 0.0, rate if aside_rad > 0 else -rate
        return self._arc(left, ahead, speed)

    def _arc(self, left: float, ahead: float, speed: float) -> Twist:
        """Return the velocity along the arc to a point, within the limits of the vehicle."""
        # Coulter's (2 x / L^2): the arc through a point that lies x to the side, L away.
        curvature = 2 * left / (ahead * ahead + left * left)
        if self._least_radius_m:
            most = 1 / self._least_radius_m
            curvature = max(-most, min(most, curvature if ahead > 0.0 else copysign(most, left)))
        if curvature:
            speed = min(speed, TURN_RATE_RADPS / abs(curvature))
        speed = max(speed, SLOWEST_MPS)
        return speed, curvature * speed


def _split(line: Line, corner_rad: float) -> list[tuple[Floats, Floats]]:
    """Return points and speeds of each part of a line between corners."""
    moves = np.diff(line.points_m, axis=0)
    if not len(moves):
        return []
    headings = np.arctan2(moves[:, 1], moves[:, 0])
    bends = np.abs((np.diff(headings) + pi) % (2 * pi) - pi)
    corners = [0, *(np.flatnonzero(bends > corner_rad) + 1).tolist(), len(moves)]
    return [
        (line.points_m[start : end + 1], line.speeds_mps[start:end])
        for start, end in pairwise(corners)
    ]
