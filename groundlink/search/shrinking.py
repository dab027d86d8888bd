# SPDX-License-Identifier: Apache-2.0
"""Shrinking: from a point that fails to one with fewer and smaller changes that still fails."""

from collections.abc import Callable, Mapping
from typing import Any

from .space import Point, Space

HALVINGS = 6
"""A number ends within 1/64 of the distance between a value that passes and one that fails."""


def shrunk(
    point: Point, origin: Mapping[str, Any], space: Space, fails: Callable[[Point], bool]
) -> Point:
    """Return the point with the fewest changes that was found, which fails.

    First each field is put back to the scenario's value if the point then still fails, until none
    can be. Then each number is moved towards the scenario's value, halfway at a time.

    Parameters
    ----------
    point
        a point that fails.
    origin
        the scenario's values by field; with all of them it passes.
    fails
        whether a point fails; always the same for the same point.
    """
    point = _put_back({n: v for n, v in point.items() if v != origin[n]}, fails)
    for field in space.fields:
        if field.name not in point:
            continue
        passing = origin[field.name]
        for _ in range(HALVINGS):
            middle = field.between(passing, point[field.name])
            if middle is None:
                break
            if fails(nearer := point | {field.name: middle}):
                point = nearer
            else:
                passing = middle
    return _put_back(point, fails)


def _put_back(point: Point, fails: Callable[[Point], bool]) -> Point:
    """Leave out one field after the other while the point fails, until none can be left out."""
    left_out = True
    while left_out:
        left_out = False
        for name in list(point):
            rest = {other: value for other, value in point.items() if other != name}
            if rest and fails(rest):
                point, left_out = rest, True
    return point
