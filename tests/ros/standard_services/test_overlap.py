# SPDX-License-Identifier: Apache-2.0
"""Overlap of regions with boxes: known cases, and random ones against the search of a plane."""

from itertools import product
from math import cos, radians, sin, sqrt

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

from udp_bridge_ros2.standard_services.overlap import ConvexRegion, Vector, box_region, rotate

LOW, HIGH = (-1.0, -0.5, -0.25), (1.0, 0.5, 0.25)
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
HALF = radians(45) / 2
TURNED = (0.0, 0.0, sin(HALF), cos(HALF))
"""By 45 degrees about z."""

TRIANGLE = ((0.0, 0.0, 0.0), (4.0, 0.0, 0.0), (0.0, 4.0, 0.0))


@pytest.mark.parametrize(
    ("region", "position", "orientation", "overlaps"),
    [
        (ConvexRegion(((0.0, 0.0, 0.0),), 1.0), (1.99, 0.0, 0.0), UPRIGHT, True),
        (ConvexRegion(((0.0, 0.0, 0.0),), 1.0), (2.0, 0.0, 0.0), UPRIGHT, True),
        (ConvexRegion(((0.0, 0.0, 0.0),), 1.0), (2.01, 0.0, 0.0), UPRIGHT, False),
        # The corner is farther than its coordinates.
        (ConvexRegion(((0.0, 0.0, 0.0),), 1.0), (1.9, 1.4, 0.0), UPRIGHT, False),
        (ConvexRegion(((0.0, 0.0, 0.0),), 1.3), (1.9, 1.4, 0.0), UPRIGHT, True),
        (ConvexRegion(((0.0, 0.0, 0.0),), 0.0), (0.0, 0.0, 0.0), UPRIGHT, True),
        (box_region((2.0, 2.0, 0.0), (3.0, 3.0, 1.0)), (3.9, 2.5, 0.5), UPRIGHT, True),
        (box_region((3.0, 3.0, 1.0), (2.0, 2.0, 0.0)), (3.9, 2.5, 0.5), UPRIGHT, True),
        (box_region((2.0, 2.0, 0.0), (3.0, 3.0, 1.0)), (4.1, 2.5, 0.5), UPRIGHT, False),
        # Turned, the box reaches less far along x; the boxes along the axes would overlap.
        (box_region((2.0, 2.0, 0.0), (3.0, 3.0, 1.0)), (4.0, 4.0, 0.5), TURNED, False),
        (box_region((2.0, 2.0, 0.0), (3.0, 3.0, 1.0)), (3.6, 3.6, 0.5), TURNED, True),
        (box_region((-9.0, -9.0, -9.0), (9.0, 9.0, 9.0)), (1.0, 2.0, 3.0), TURNED, True),
        (box_region(LOW, HIGH), (0.0, 0.0, 0.0), UPRIGHT, True),
        (ConvexRegion(TRIANGLE), (1.0, 1.0, 0.2), UPRIGHT, True),
        (ConvexRegion(TRIANGLE), (1.0, 1.0, 0.3), UPRIGHT, False),
        (ConvexRegion(TRIANGLE), (3.1, 3.1, 0.0), TURNED, False),
        (ConvexRegion(TRIANGLE), (2.3, 2.3, 0.0), TURNED, True),
        (ConvexRegion(TRIANGLE * 3), (1.0, 1.0, 0.2), UPRIGHT, True),
        (ConvexRegion((*TRIANGLE, (0.0, 0.0, 4.0))), (1.0, 1.0, 1.5), UPRIGHT, True),
        (ConvexRegion((*TRIANGLE, (0.0, 0.0, 4.0))), (2.9, 1.9, 1.5), UPRIGHT, False),
    ],
)
def test_overlap_of_known_shapes(
    region: ConvexRegion, position: Vector, orientation: tuple[float, ...], overlaps: bool
) -> None:
    x, y, z, w = orientation
    assert region.overlaps(position, (x, y, z, w), LOW, HIGH) is overlaps


def test_a_quaternion_turns_as_scipy_does() -> None:
    turn = Rotation.from_euler("xyz", [0.3, -0.8, 2.1])
    x, y, z, w = turn.as_quat()
    assert rotate((x, y, z, w), (1.0, -2.0, 0.5)) == pytest.approx(turn.apply([1.0, -2.0, 0.5]))


def share_a_point(one: np.ndarray, other: np.ndarray) -> bool:
    """Return whether two hulls have a point in common, by linear programming."""
    equal = np.vstack(
        [
            np.hstack([one.T, -other.T]),
            np.hstack([np.ones(len(one)), np.zeros(len(other))]),
            np.hstack([np.zeros(len(one)), np.ones(len(other))]),
        ]
    )
    found = linprog(np.zeros(len(one) + len(other)), A_eq=equal, b_eq=[0.0, 0.0, 0.0, 1.0, 1.0])
    return bool(found.success)


def test_overlap_of_random_hulls_is_that_of_linear_programming() -> None:
    draw = np.random.default_rng(7)
    results = []
    for _ in range(150):
        turn = Rotation.random(random_state=draw)
        position = draw.normal(0.0, 1.2, 3)
        points = draw.normal(0.0, 1.0, (int(draw.integers(3, 12)), 3))
        if draw.random() < 0.3:
            points[:, 2] = 0.0  # a flat hull
        corners = turn.apply(list(product(*zip(LOW, HIGH, strict=True)))) + position
        x, y, z, w = turn.as_quat()
        region = ConvexRegion(tuple((px, py, pz) for px, py, pz in points.tolist()))
        px, py, pz = position
        results.append(region.overlaps((px, py, pz), (x, y, z, w), LOW, HIGH))
        assert results[-1] is share_a_point(points, corners)
    assert 40 < sum(results) < 110


def test_distance_of_a_sphere_to_an_edge() -> None:
    edge = (1.0 + 1 / sqrt(2), 0.5 + 1 / sqrt(2), 0.0)
    for radius_m, overlaps in ((0.999, False), (1.001, True)):
        region = ConvexRegion((edge,), radius_m)
        assert region.overlaps((0.0, 0.0, 0.0), UPRIGHT, LOW, HIGH) is overlaps
