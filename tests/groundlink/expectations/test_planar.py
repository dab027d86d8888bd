# SPDX-License-Identifier: Apache-2.0
"""Poses on the ground are interpolated and aligned; distances from an area have a sign."""

from math import pi

import pytest

from groundlink.expectations.planar import PlanarPose, between, laid_on, outside_m

SQUARE = ((0.0, 0.0), (4.0, 0.0), (4.0, 2.0), (0.0, 2.0))


@pytest.mark.parametrize(
    ("point", "expected"),
    [
        ((1.0, 1.0), -1.0),
        ((3.5, 1.0), -0.5),
        ((4.0, 1.0), 0.0),
        ((5.0, 1.0), 1.0),
        ((-1.0, 1.0), 1.0),
        ((7.0, 6.0), 5.0),
    ],
)
def test_distance_from_an_area(point: tuple[float, float], expected: float) -> None:
    assert outside_m(point, SQUARE) == pytest.approx(expected)
    assert outside_m(point, SQUARE[::-1]) == pytest.approx(expected)
    assert outside_m(point, (*SQUARE, SQUARE[0])) == pytest.approx(expected)


def test_headings_are_interpolated_the_short_way() -> None:
    middle = between(PlanarPose(1, 0, 0, pi - 0.1), PlanarPose(2, 1, 2, 0.3 - pi), 1.5)
    assert middle == pytest.approx((1.5, 0.5, 1.0, pi + 0.1))
    assert between(middle, middle, 1.5) == middle


def test_the_first_estimate_lies_on_the_truth() -> None:
    first, truth = PlanarPose(1, 5, 5, pi / 2), PlanarPose(1, 1, 2, 0)
    assert laid_on(first, first, truth) == pytest.approx(truth)
    assert laid_on(PlanarPose(2, 5, 7, pi), first, truth) == pytest.approx((2, 3, 2, pi / 2))
