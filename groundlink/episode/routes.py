# SPDX-License-Identifier: Apache-2.0
"""Geometry of routes: the line on the ground, in x and y of the world.

A figure starts at the base of the vehicle, along its heading. Waypoints are world positions; the
line includes the path to the first one.
"""

from dataclasses import dataclass
from math import cos, pi, sin

import numpy as np
from numpy.typing import NDArray

from groundlink.scenario import route as specs

Floats = NDArray[np.float64]

STEPS = 180
"""Chords of a circle; for a radius of 10 m they deviate by at most 1.6 mm."""

SAME_M = 1e-6
"""Points closer than this count as one."""


@dataclass(frozen=True)
class Line:
    """Straight segments between points, each with a target speed."""

    points_m: Floats
    """Shape (N, 2), N >= 1: x, y in the world; consecutive points differ."""

    speeds_mps: Floats
    """Shape (N - 1,)."""

    @property
    def length_m(self) -> float:
        """Total length."""
        return float(np.linalg.norm(np.diff(self.points_m, axis=0), axis=1).sum())


def line(route: specs.Route, *, start_m: tuple[float, float], heading_rad: float) -> Line:
    """Return all laps of a route as one line, from the position of a vehicle.

    Parameters
    ----------
    start_m
        x, y of the vehicle's base in the world.
    heading_rad
        its yaw; 0 is east.
    """
    if isinstance(route, specs.Waypoints):
        return _through(route, np.array(start_m))
    lap = _figure(route)
    turn = np.array([[cos(heading_rad), -sin(heading_rad)], [sin(heading_rad), cos(heading_rad)]])
    laps = np.vstack([lap[:1], *[lap[1:]] * route.laps])
    return _joined(laps @ turn.T + start_m, np.full(len(laps) - 1, route.speed_mps))


def _through(route: specs.Waypoints, start_m: Floats) -> Line:
    points = [[point.x_m, point.y_m] for point in route.points]
    speeds = [point.speed_mps or route.speed_mps for point in route.points]
    if route.closed:
        back = (points[0], speeds[0])
        for lap in range(route.laps):
            if lap:
                points += [[point.x_m, point.y_m] for point in route.points[1:]]
                speeds += [point.speed_mps or route.speed_mps for point in route.points[1:]]
            points.append(back[0])
            speeds.append(back[1])
    return _joined(np.vstack([start_m, points]), np.array(speeds))


def _joined(points: Floats, speeds: Floats) -> Line:
    """Return the line through points, without repeated points."""
    moves = np.linalg.norm(np.diff(points, axis=0), axis=1) > SAME_M
    return Line(points[np.concatenate([[True], moves])], speeds[moves])


def _figure(route: specs.Circle | specs.FigureEight | specs.Square | specs.ThereAndBack) -> Floats:
    """Return one lap in the vehicle's initial frame: x forward, y left."""
    match route:
        case specs.Circle():
            return _circle(route.radius_m, route.turn)
        case specs.FigureEight():
            other: specs.Side = "right" if route.turn == "left" else "left"
            return np.vstack(
                [_circle(route.radius_m, route.turn), _circle(route.radius_m, other)[1:]]
            )
        case specs.Square():
            corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]) * route.side_m
            return corners * (1.0, _sign(route.turn))
        case specs.ThereAndBack():
            return np.array([[0.0, 0.0], [route.length_m, 0.0], [0.0, 0.0]])


def _circle(radius_m: float, turn: specs.Side) -> Floats:
    angle = np.linspace(0.0, 2 * pi, STEPS + 1)
    return radius_m * np.stack([np.sin(angle), _sign(turn) * (1 - np.cos(angle))], axis=-1)


def _sign(turn: specs.Side) -> float:
    return 1.0 if turn == "left" else -1.0
