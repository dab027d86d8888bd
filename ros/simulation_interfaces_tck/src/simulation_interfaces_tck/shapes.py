# SPDX-License-Identifier: Apache-2.0
"""Poses and bounds: made, compared and judged."""

import math
from collections.abc import Sequence
from typing import Any

from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Vector3
from simulation_interfaces.msg import Bounds
from std_msgs.msg import Header

UP = (0.0, 0.0, 0.0, 1.0)
"""Quaternion (x, y, z, w) of an entity that is not turned."""


def pose_at(
    place: Sequence[float], turned: Sequence[float] = UP, *, heading: float | None = None
) -> Any:
    """Return a Pose at a place in meters, turned by a quaternion or a heading in radians."""
    if heading is not None:
        turned = (0.0, 0.0, math.sin(heading / 2), math.cos(heading / 2))
    x, y, z, w = turned
    return Pose(
        position=Point(x=place[0], y=place[1], z=place[2]),
        orientation=Quaternion(x=x, y=y, z=z, w=w),
    )


def stamped(pose: Any, frame: str = "") -> Any:
    """Return a PoseStamped."""
    return PoseStamped(header=Header(frame_id=frame), pose=pose)


def place_of(pose: Any) -> tuple[float, float, float]:
    """Return the position of a Pose in meters."""
    return (pose.position.x, pose.position.y, pose.position.z)


def heading_of(pose: Any) -> float:
    """Return the heading of a Pose in radians."""
    q = pose.orientation
    return math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))


def distance(one: Any, other: Any) -> float:
    """Return the distance of two Poses along the ground, in meters.

    The height is left out: a simulator may let an entity settle on the ground.
    """
    return math.dist(place_of(one)[:2], place_of(other)[:2])


def turn(one: Any, other: Any) -> float:
    """Return the angle between the headings of two Poses in radians."""
    return abs(math.remainder(heading_of(one) - heading_of(other), math.tau))


def is_unit(quaternion: Any) -> bool:
    """Return whether a Quaternion is of length 1, to a thousandth."""
    parts = (quaternion.x, quaternion.y, quaternion.z, quaternion.w)
    return math.isclose(math.hypot(*parts), 1.0, abs_tol=1e-3)


def _bounds(kind: int, *points: Sequence[float]) -> Any:
    return Bounds(type=kind, points=[Vector3(x=x, y=y, z=z) for x, y, z in points])


def sphere(center: Sequence[float], radius: float) -> Any:
    """Return Bounds of TYPE_SPHERE."""
    return _bounds(Bounds.TYPE_SPHERE, center, (radius, 0.0, 0.0))


def box(lower: Sequence[float], upper: Sequence[float]) -> Any:
    """Return Bounds of TYPE_BOX: the upper right corner is first."""
    return _bounds(Bounds.TYPE_BOX, upper, lower)


def cube(center: Sequence[float], half: float) -> Any:
    """Return Bounds of TYPE_BOX around a center."""
    return box([at - half for at in center], [at + half for at in center])


def octahedron(center: Sequence[float], half: float) -> Any:
    """Return Bounds of TYPE_CONVEX_HULL with six corners around a center."""
    corners = []
    for axis in range(3):
        for side in (-half, half):
            corners.append([at + side * (axis == i) for i, at in enumerate(center)])
    return _bounds(Bounds.TYPE_CONVEX_HULL, *corners)


def flaw_of(bounds: Any) -> str:
    """Return what makes Bounds invalid, or nothing."""
    points = [(point.x, point.y, point.z) for point in bounds.points]
    if not all(math.isfinite(value) for point in points for value in point):
        return "a point is not finite"
    if bounds.type == Bounds.TYPE_EMPTY:
        return "TYPE_EMPTY has points" if points else ""
    if bounds.type == Bounds.TYPE_CONVEX_HULL:
        return "" if _spans_a_plane(points) else "TYPE_CONVEX_HULL needs 3 non-collinear points"
    if bounds.type not in (Bounds.TYPE_BOX, Bounds.TYPE_SPHERE):
        return f"{bounds.type} is no type of bounds"
    if len(points) != 2:
        return f"a box or a sphere needs 2 points, got {len(points)}"
    if bounds.type == Bounds.TYPE_SPHERE:
        return "" if points[1][0] > 0 else "the radius of the sphere is not positive"
    is_ordered = all(high >= low for high, low in zip(*points, strict=True))
    return "" if is_ordered else "the first corner of the box is not the upper right one"


def _spans_a_plane(points: Sequence[Sequence[float]]) -> bool:
    if len(points) < 3:
        return False
    origin = points[0]
    edges = [[a - b for a, b in zip(point, origin, strict=True)] for point in points[1:]]
    return any(_cross_length(one, other) > 1e-12 for one in edges for other in edges)


def _cross_length(a: Sequence[float], b: Sequence[float]) -> float:
    return math.hypot(
        a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    )
