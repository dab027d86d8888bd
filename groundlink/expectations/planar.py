# SPDX-License-Identifier: Apache-2.0
"""Poses on the ground: interpolation, alignment, and the distance from an area."""

from collections.abc import Iterable
from math import cos, hypot, pi, sin
from typing import NamedTuple

from groundlink.core.fields import Quaternion, Vector3
from groundlink.core.quaternions import heading_rad

Point = tuple[float, float]


class PlanarPose(NamedTuple):
    """Pose of a vehicle's base on the ground."""

    seconds: float
    x_m: float
    y_m: float
    heading_rad: float


def planar(seconds: float, position_m: Vector3, orientation: Quaternion) -> PlanarPose:
    """Return a pose on the ground from one in space."""
    return PlanarPose(seconds, position_m[0], position_m[1], heading_rad(orientation))


def between(first: PlanarPose, second: PlanarPose, seconds: float) -> PlanarPose:
    """Return the pose at an instant between two poses, by linear interpolation."""
    span = second.seconds - first.seconds
    share = (seconds - first.seconds) / span if span > 0 else 0.0
    turned = wrapped(second.heading_rad - first.heading_rad)
    return PlanarPose(
        seconds,
        first.x_m + share * (second.x_m - first.x_m),
        first.y_m + share * (second.y_m - first.y_m),
        first.heading_rad + share * turned,
    )


def outside_m(point: Point, corners: Iterable[Point]) -> float:
    """Return how far a point is outside of a polygon; inside, minus the distance to its border."""
    x, y = point
    ends = list(corners)
    nearest, is_inside = float("inf"), False
    for (ax, ay), (bx, by) in zip(ends, [*ends[1:], ends[0]], strict=True):
        dx, dy = bx - ax, by - ay
        length = dx * dx + dy * dy
        along = ((x - ax) * dx + (y - ay) * dy) / length if length else 0.0
        along = min(1.0, max(0.0, along))
        nearest = min(nearest, hypot(ax + along * dx - x, ay + along * dy - y))
        if (ay > y) != (by > y) and x < ax + (y - ay) * dx / dy:
            is_inside = not is_inside
    return -nearest if is_inside else nearest


def laid_on(estimate: PlanarPose, first: PlanarPose, truth: PlanarPose) -> PlanarPose:
    """Return an estimate moved and turned as the first one has to be to lie on the truth."""
    turn = truth.heading_rad - first.heading_rad
    x, y = estimate.x_m - first.x_m, estimate.y_m - first.y_m
    c, s = cos(turn), sin(turn)
    return PlanarPose(
        estimate.seconds,
        truth.x_m + c * x - s * y,
        truth.y_m + s * x + c * y,
        estimate.heading_rad + turn,
    )


def wrapped(angle: float) -> float:
    """Return an angle between -pi and pi."""
    return (angle + pi) % (2 * pi) - pi
