# SPDX-License-Identifier: Apache-2.0
"""The line on the floor that a route means.

Rule: pure geometry in the world's x and y. A figure begins at the vehicle's base and along its
heading; waypoints are where they are, and the way to the first of them is a part of the line.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi, sin

import numpy as np
from numpy.typing import NDArray

from groundlink.scenario.route import (
    Circle,
    FigureEight,
    Route,
    Side,
    Square,
    ThereAndBack,
    Waypoints,
)

Floats = NDArray[np.float64]

STEPS = 180
"""Chords of a circle: with a radius of 10 m, none is farther than 1.6 mm from it."""

SAME_M = 1e-6
"""Points nearer than this are one."""


@dataclass(frozen=True)
class Line:
    """Straight pieces between points, each with the speed that is asked for on it."""

    points_m: Floats
    """Shape (N, 2), N >= 1: x, y in the world; no two neighbours are the same."""

    speeds_mps: Floats
    """Shape (N - 1,)."""

    @property
    def length_m(self) -> float:
        """The whole length."""
        return float(np.linalg.norm(np.diff(self.points_m, axis=0), axis=1).sum())


def line(route: Route, *, start_m: tuple[float, float], heading_rad: float) -> Line:
    """Return all laps of a route as one line, from where a vehicle stands.

    Parameters
    ----------
    start_m
        x, y of the vehicle's base in the world.
    heading_rad
        its yaw; 0 is east.
    """
    if isinstance(route, Waypoints):
        return _through(route, np.array(start_m))
    lap = _figure(route)
    turn = np.array([[cos(heading_rad), -sin(heading_rad)], [sin(heading_rad), cos(heading_rad)]])
    laps = np.vstack([lap[:1], *[lap[1:]] * route.laps])
    return _joined(laps @ turn.T + start_m, np.full(len(laps) - 1, route.speed_mps))


def _through(route: Waypoints, start_m: Floats) -> Line:
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
    """Return the line through points, without those that repeat the one before."""
    moves = np.linalg.norm(np.diff(points, axis=0), axis=1) > SAME_M
    return Line(points[np.concatenate([[True], moves])], speeds[moves])


def _figure(route: Circle | FigureEight | Square | ThereAndBack) -> Floats:
    """Return one lap in the vehicle's frame at its start: x ahead, y to the left."""
    match route:
        case Circle():
            return _circle(route.radius_m, route.turn)
        case FigureEight():
            other: Side = "right" if route.turn == "left" else "left"
            return np.vstack(
                [_circle(route.radius_m, route.turn), _circle(route.radius_m, other)[1:]]
            )
        case Square():
            corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]) * route.side_m
            return corners * (1.0, _sign(route.turn))
        case ThereAndBack():
            return np.array([[0.0, 0.0], [route.length_m, 0.0], [0.0, 0.0]])


def _circle(radius_m: float, turn: Side) -> Floats:
    angle = np.linspace(0.0, 2 * pi, STEPS + 1)
    return radius_m * np.stack([np.sin(angle), _sign(turn) * (1 - np.cos(angle))], axis=-1)


def _sign(turn: Side) -> float:
    return 1.0 if turn == "left" else -1.0
