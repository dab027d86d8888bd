# SPDX-License-Identifier: Apache-2.0
"""Distances to shapes, inside and outside, turned and moved."""

import math

import numpy as np
import pytest

from experiments.estimation.surfaces import distances_m
from groundlink.world.solids import Box, Cylinder, Mesh, Shape, Solid, Sphere

QUARTER = (0.0, 0.0, math.sin(math.pi / 4), math.cos(math.pi / 4))


@pytest.mark.parametrize(
    ("shape", "point", "distance"),
    [
        (Box(size_m=(2.0, 4.0, 6.0)), (3.0, 0.0, 0.0), 2.0),
        (Box(size_m=(2.0, 4.0, 6.0)), (0.9, 0.0, 0.0), 0.1),
        (Box(size_m=(2.0, 4.0, 6.0)), (4.0, 6.0, 0.0), 5.0),
        (Cylinder(radius_m=1.0, length_m=2.0), (3.0, 4.0, 0.0), 4.0),
        (Cylinder(radius_m=1.0, length_m=2.0), (0.0, 0.0, 0.75), 0.25),
        (Cylinder(radius_m=1.0, length_m=2.0), (4.0, 0.0, 5.0), 5.0),
        (Sphere(radius_m=2.0), (0.0, 1.5, 0.0), 0.5),
    ],
)
def test_distances(shape: Shape, point: tuple[float, ...], distance: float) -> None:
    assert distances_m(np.array([point]), [Solid("a", shape, "b")]) == pytest.approx(distance)


def test_a_solid_is_where_it_was_put_and_the_nearest_counts() -> None:
    box = Solid("a", Box(size_m=(2.0, 4.0, 6.0)), "b", (10.0, 0.0, 0.0), QUARTER)
    ball = Solid("c", Sphere(radius_m=1.0), "b", (0.0, 20.0, 0.0))
    points = np.array([[7.0, 0.0, 0.0], [10.0, 2.0, 0.0], [0.0, 18.0, 0.0]])
    assert distances_m(points, [box, ball]) == pytest.approx([1.0, 1.0, 1.0])


def test_a_mesh_is_refused() -> None:
    mesh = Mesh(asset="0" * 64, low_m=(0.0, 0.0, 0.0), high_m=(1.0, 1.0, 1.0))
    with pytest.raises(TypeError, match="no distance to a Mesh"):
        distances_m(np.zeros((1, 3)), [Solid("m", mesh, "b")])
