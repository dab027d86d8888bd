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


class Leg:
    """A part of a line, addressed by the distance from its start.

    Parameters
    ----------
    points
        shape (N, 2), N >= 2: x, y in the world; consecutive points differ.
    speeds
        shape (N - 1,): target speed of each segment.
    """

    def __init__(self, points: Floats, speeds: Floats) -> None:
        self._points, self._speeds = points, speeds
        moves = np.diff(points, axis=0)
        self._lengths = np.linalg.norm(moves, axis=1)
        self._directions = moves / self._lengths[:, None]
        self._starts_m = np.concatenate([[0.0], np.cumsum(self._lengths)])
        self.length_m = float(self._starts_m[-1])

    def nearest(self, place: Floats, start_m: float, end_m: float) -> tuple[float, float]:
        """Return how far along the nearest point is, from `start_m` to `end_m`, and its distance.

        Of several that are equally near within a centimeter, the first.
        """
        first = max(int(np.searchsorted(self._starts_m, start_m, "right")) - 1, 0)
        last = max(int(np.searchsorted(self._starts_m, end_m, "left")), first + 1)
        pieces = slice(min(first, len(self._lengths) - 1), last)
        starts, lengths = self._starts_m[pieces.start : -1][: last - first], self._lengths[pieces]
        offsets = place - self._points[:-1][pieces]
        along = np.clip(np.sum(offsets * self._directions[pieces], axis=1), 0.0, lengths)
        along = np.clip(along, start_m - starts, max(end_m, start_m) - starts)
        apart = np.linalg.norm(offsets - along[:, None] * self._directions[pieces], axis=1)
        i = int(np.argmax(apart <= apart.min() + 0.01))
        # From the first that is near enough, continue to the local minimum.
        while i + 1 < len(apart) and apart[i + 1] < apart[i]:
            i += 1
        return float(starts[i] + along[i]), float(apart[i])

    def speed_mps(self, at_m: float) -> float:
        """Return the speed of the line at a distance from its start."""
        return float(self._speeds[self._piece(at_m)])

    def point(self, at_m: float) -> Floats:
        """Return the point at a distance from the start; beyond the end, straight on."""
        i = self._piece(at_m)
        point: Floats = self._points[i] + (at_m - self._starts_m[i]) * self._directions[i]
        return point

    def _piece(self, at_m: float) -> int:
        piece = int(np.searchsorted(self._starts_m, at_m, "right")) - 1
        return min(piece, len(self._lengths) - 1)


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
