# SPDX-License-Identifier: Apache-2.0
"""The plan shows what a vehicle could meet, with its outline."""

import numpy as np
import pytest

from groundlink.loader import load
from groundlink.report.analysis.plan import outlines
from groundlink.scene.build import solids
from groundlink.world.solids import Box, Cylinder, Shape, Solid

TURNED = (0.0, 0.0, np.sin(np.pi / 8), np.cos(np.pi / 8))


def area(corners: np.ndarray) -> float:
    x, y = corners.T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2)


@pytest.mark.parametrize(
    ("shape", "count", "expected"),
    [
        (Box(size_m=(2.0, 1.0, 0.5)), 4, 2.0),
        (Cylinder(radius_m=0.5, length_m=0.5), 24, np.pi / 4),
    ],
)
def test_an_outline_is_that_of_the_solid_counterclockwise(
    shape: Shape, count: int, expected: float
) -> None:
    [outline] = outlines([Solid("thing", shape, "m", (3.0, 4.0, 0.25), TURNED)])
    assert len(outline.corners_m) == count
    assert area(outline.corners_m) == pytest.approx(expected, rel=0.02)
    np.testing.assert_allclose(outline.corners_m.mean(axis=0), [3.0, 4.0], atol=1e-6)
    assert (outline.low_m, outline.high_m) == pytest.approx((0.0, 0.5))


def test_floor_and_ceiling_are_left_out_and_low_things_come_first() -> None:
    found = outlines(solids(load("indoor_lab")))
    names = {outline.name for outline in found}
    assert "table_0_top" in names
    assert "wall_north_whole" in names
    assert not {"room_floor", "room_ceiling", "wall_south_lintel"} & names
    heights = [outline.high_m for outline in found]
    assert heights == sorted(heights)
