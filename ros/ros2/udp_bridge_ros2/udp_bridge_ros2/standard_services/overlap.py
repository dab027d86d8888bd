# SPDX-License-Identifier: Apache-2.0
"""Overlap of a convex region with an oriented box.

The algorithm is that of Gilbert, Johnson and Keerthi (1988): the distance between two convex
shapes, from the point of each that is farthest along a direction.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, product
from typing import NamedTuple

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
"""x, y, z, w; of unit length."""

TOUCHING_M = 1e-9
"""Shapes this close to each other overlap."""
_ROUNDS = 64
_ROUNDING = 1e-12


class ConvexRegion(NamedTuple):
    """Convex hull of points, and what is within a radius of it."""

    points: tuple[Vector, ...]
    radius_m: float = 0.0

    def overlaps(
        self, position: Vector, orientation: Quaternion, low: Vector, high: Vector
    ) -> bool:
        """Return whether the region reaches a box, given by two corners in its own frame."""
        inverse = (-orientation[0], -orientation[1], -orientation[2], orientation[3])
        points = [rotate(inverse, _minus(point, position)) for point in self.points]
        return _reaches(points, self.radius_m + TOUCHING_M, low, high)


def box_region(low: Vector, high: Vector) -> ConvexRegion:
    """Return the region of a box along the axes."""
    x, y, z = zip(low, high, strict=True)
    return ConvexRegion(tuple(product(x, y, z)))


def rotate(orientation: Quaternion, vector: Vector) -> Vector:
    """Rotate a vector by a quaternion."""
    x, y, z, w = orientation
    axis = (x, y, z)
    twice = _cross(axis, vector)
    twice = (2 * twice[0], 2 * twice[1], 2 * twice[2])
    across = _cross(axis, twice)
    return (
        vector[0] + w * twice[0] + across[0],
        vector[1] + w * twice[1] + across[1],
        vector[2] + w * twice[2] + across[2],
    )


def _reaches(points: Sequence[Vector], radius_m: float, low: Vector, high: Vector) -> bool:
    """Return whether the hull of points is within a radius of the box from `low` to `high`.

    Differences of a point of the hull and a point of the box form a convex shape, too. `nearest` is
    its point nearest to the origin so far, and lies in the simplex of a few corners of that shape.
    """
    first = points[0]
    clamped = (
        min(max(first[0], low[0]), high[0]),
        min(max(first[1], low[1]), high[1]),
        min(max(first[2], low[2]), high[2]),
    )
    nearest = _minus(first, clamped)
    simplex: list[Vector] = []
    for _ in range(_ROUNDS):
        squared = _dot(nearest, nearest)
        if squared <= radius_m**2:
            return True
        along = nearest
        point = min(points, key=lambda vector: _dot(vector, along))
        corner = (
            high[0] if along[0] > 0 else low[0],
            high[1] if along[1] > 0 else low[1],
            high[2] if along[2] > 0 else low[2],
        )
        difference = _minus(point, corner)
        reach = _dot(difference, along)
        is_separated = reach > 0 and reach**2 > radius_m**2 * squared
        if is_separated or squared - reach <= _ROUNDING * squared or difference in simplex:
            return False
        simplex, nearest = _nearest_of([*simplex, difference])
    return True  # the shapes touch, up to rounding


def _nearest_of(simplex: Sequence[Vector]) -> tuple[list[Vector], Vector]:
    """Return the point of a simplex nearest to the origin, and the corners that span it."""
    best: tuple[float, list[Vector], Vector] | None = None
    for size in range(1, len(simplex) + 1):
        for corners in combinations(simplex, size):
            nearest = _nearest_inside(corners)
            if nearest and (best is None or _dot(nearest, nearest) < best[0]):
                best = (_dot(nearest, nearest), list(corners), nearest)
    assert best, "a single corner always has a nearest point"
    return best[1], best[2]


def _nearest_inside(corners: Sequence[Vector]) -> Vector | None:
    """Return the point nearest to the origin of the plane through corners, if between them."""
    origin, *others = corners
    edges = [_minus(corner, origin) for corner in others]
    weights = _solve(
        [[_dot(one, other) for other in edges] for one in edges],
        [-_dot(edge, origin) for edge in edges],
    )
    if weights is None or min(weights, default=0.0) < 0 or sum(weights) > 1:
        return None
    x, y, z = origin
    for weight, edge in zip(weights, edges, strict=True):
        x, y, z = x + weight * edge[0], y + weight * edge[1], z + weight * edge[2]
    return (x, y, z)


def _solve(matrix: list[list[float]], right: list[float]) -> list[float] | None:
    """Solve a symmetric system by elimination; return None if it is singular."""
    rows = [[*row, value] for row, value in zip(matrix, right, strict=True)]
    for index, pivot in enumerate(rows):
        if pivot[index] <= _ROUNDING * matrix[index][index]:
            return None
        for row in rows:
            if row is not pivot:
                factor = row[index] / pivot[index]
                for column in range(index, len(pivot)):
                    row[column] -= factor * pivot[column]
    return [row[-1] / row[index] for index, row in enumerate(rows)]


def _minus(one: Vector, other: Vector) -> Vector:
    return (one[0] - other[0], one[1] - other[1], one[2] - other[2])


def _dot(one: Vector, other: Vector) -> float:
    return one[0] * other[0] + one[1] * other[1] + one[2] * other[2]


def _cross(one: Vector, other: Vector) -> Vector:
    return (
        one[1] * other[2] - one[2] * other[1],
        one[2] * other[0] - one[0] * other[2],
        one[0] * other[1] - one[1] * other[0],
    )
