# SPDX-License-Identifier: Apache-2.0
"""Occupancy: cells against answers that are known, and against points drawn in solids."""

from math import cos, radians, sin

import numpy as np
import pytest

from groundlink.core.errors import UserError
from groundlink.core.frames import matrix_from_quaternion, quaternion_from_rpy
from groundlink.world import assets
from groundlink.world.mesh_asset import encode_mesh
from groundlink.world.occupancy import FREE, OCCUPIED, UNKNOWN, MapGrid, grid_around, occupancy
from groundlink.world.solids import Box, Cylinder, Mesh, Shape, Solid, Sphere
from groundlink.world.terrain import Ground

PLANE = (0.5, 0.5)
FLOOR = Solid("floor", Box(size_m=(2.0, 1.0, 0.1)), "m", (1.0, 0.5, -0.05))


def grid(rows: int = 10, columns: int = 20, yaw_rad: float = 0.0) -> MapGrid:
    return MapGrid(0.1, 0.0, 0.0, yaw_rad, rows, columns)


def cells(*static: Solid, heights_m: tuple[float, float] = PLANE) -> np.ndarray:
    return occupancy(grid(), static, None, heights_m).cells


def test_a_box_fills_exactly_the_cells_between_its_sides() -> None:
    box = Solid("box", Box(size_m=(0.3, 0.2, 1.0)), "m", (0.55, 0.3, 0.5))
    found = cells(FLOOR, box)
    assert (found == OCCUPIED).sum() == 3 * 2
    assert (found[2:4, 4:7] == OCCUPIED).all()
    assert (found == FREE).sum() == 200 - 6
    assert (cells(box) == UNKNOWN).sum() == 200 - 6


def test_a_millimeter_beyond_the_border_of_a_cell_does_not_count() -> None:
    for beyond_m, count in ((0.0009, 3), (0.0011, 4)):
        size = 0.3 + beyond_m, 0.1, 1.0
        box = Solid("box", Box(size_m=size), "m", (0.4 + size[0] / 2, 0.25, 0.5))
        assert (cells(box) == OCCUPIED).sum() == count
    plate = Solid("plate", Box(size_m=(0.0004, 0.1, 1.0)), "m", (0.5, 0.25, 0.5))
    assert (cells(plate) == OCCUPIED).sum() == 2  # on the border of both


@pytest.mark.parametrize(
    ("heights_m", "value"),
    [
        ((0.0, 0.3), FREE),
        ((0.3, 0.3), FREE),
        ((0.0, 0.4), FREE),
        ((0.4, 0.41), OCCUPIED),
        ((0.5, 0.5), OCCUPIED),
        ((0.6, 2.0), FREE),
    ],
)
def test_only_solids_within_the_heights_are_obstacles(
    heights_m: tuple[float, float], value: int
) -> None:
    beam = Solid("beam", Box(size_m=(2.0, 1.0, 0.2)), "m", (1.0, 0.5, 0.5))
    assert set(np.unique(cells(FLOOR, beam, heights_m=heights_m))) == {value}


@pytest.mark.parametrize(
    "shape",
    [Box(size_m=(0.7, 0.25, 0.6)), Cylinder(radius_m=0.3, length_m=0.5), Sphere(radius_m=0.35)],
)
@pytest.mark.parametrize("yaw_rad", [0.0, 0.4])
def test_cells_are_those_of_points_in_a_leaning_solid(shape: Shape, yaw_rad: float) -> None:
    """All cells with points well inside are occupied; all occupied cells are near some point."""
    turn = quaternion_from_rpy(0.3, -0.5, 0.7)
    where = grid(yaw_rad=yaw_rad)
    place = np.array([cos(yaw_rad), sin(yaw_rad), 0.0]) * 0.9 + np.array([0.0, 0.45, 0.5])
    solid = Solid("it", shape, "m", tuple(place.tolist()), turn)
    found = occupancy(where, [solid], None, (0.4, 0.55)).cells == OCCUPIED
    draw = np.random.default_rng(1).uniform(-0.5, 0.5, (200_000, 3))
    match shape:
        case Box(size_m=size):
            inside = (np.abs(draw) < np.array(size) / 2).all(axis=1)
        case Cylinder(radius_m=radius, length_m=length):
            # The facets of rays: the apothem of 24 is 0.9 % shorter.
            inside = (np.hypot(draw[:, 0], draw[:, 1]) < 0.991 * radius) & (
                np.abs(draw[:, 2]) < length / 2
            )
        case Sphere(radius_m=radius):
            inside = np.linalg.norm(draw, axis=1) < 0.98 * radius
    points = draw[inside] @ matrix_from_quaternion(np.array(turn)).T + place
    points = points[(points[:, 2] > 0.4) & (points[:, 2] < 0.55)]
    hit = np.zeros_like(found)
    at = where.in_cells(points[:, :2])
    well = ((at % 1 > 0.02) & (at % 1 < 0.98)).all(axis=1)
    column, row = at[well].astype(int).T
    hit[row, column] = True
    assert hit.sum() > 10
    assert not (hit & ~found).any()
    assert (found & ~hit).sum() <= 0.15 * found.sum()


def test_an_open_mesh_occupies_the_cells_that_its_triangles_cross() -> None:
    corners = np.array([[0, 0, 0], [0.45, 0, 0], [0.45, 0, 1], [0, 0, 1]], np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.uint32)
    mesh = Mesh(asset=assets.put(encode_mesh(corners, faces)), low_m=(0, 0, 0), high_m=(1, 0, 1))
    wall = Solid("wall", mesh, "m", (0.25, 0.35, 0.0))
    found = cells(wall)
    assert (found == OCCUPIED).sum() == 5
    assert (found[3, 2:7] == OCCUPIED).all()
    between = Solid("wall", mesh, "m", (0.25, 0.3, 0.0))
    assert (cells(between)[2:4, 2:7] == OCCUPIED).all()


def test_heights_count_from_the_terrain() -> None:
    heights = np.full((3, 3), 4.0, np.float32)
    ground = Ground(heights, np.zeros((2, 2), np.uint8), 1.0, 0.0, 0.0, ("m",))
    box = Solid("box", Box(size_m=(0.1, 0.1, 1.0)), "m", (0.55, 0.25, 4.5))
    low = Solid("low", Box(size_m=(0.1, 0.1, 1.0)), "m", (0.55, 0.75, 0.5))
    found = occupancy(grid(30, 30), [box, low], ground, PLANE).cells
    assert np.argwhere(found == OCCUPIED).tolist() == [[2, 5]]
    assert (found[:20, :20] != UNKNOWN).all()
    assert (found == UNKNOWN).sum() == 900 - 400


def test_a_grid_lies_around_all_at_multiples_of_a_cell() -> None:
    box = Solid("box", Box(size_m=(1.0, 1.0, 1.0)), "m", (10.02, -3.0, 0.0))
    found = grid_around([FLOOR, box], None, 0.1)
    assert (found.x_m, found.y_m) == pytest.approx((0.0, -3.5))
    assert (found.columns, found.rows) == (106, 45)
    ground = Ground(np.zeros((3, 5), np.float32), np.zeros((2, 4), np.uint8), 10.0, -5.0, 5.0, ())
    found = grid_around([FLOOR], ground, 0.5)
    assert (found.x_m, found.y_m, found.columns, found.rows) == (-5.0, 0.0, 80, 50)


def test_worlds_without_a_map_are_refused() -> None:
    with pytest.raises(UserError, match="without solids"):
        grid_around([], None, 0.1)
    far = Solid("far", Box(size_m=(1.0, 1.0, 1.0)), "m", (9e4, 9e4, 0.0))
    with pytest.raises(UserError, match=r"too large; expected at most 16,000,000 cells"):
        grid_around([FLOOR, far], None, 0.1)


def test_centers_are_in_the_cells_that_they_are_the_centers_of() -> None:
    turned = MapGrid(0.1, 3.0, -2.0, radians(30), 4, 6)
    at = turned.in_cells(turned.centers_m().reshape(-1, 2)).reshape(4, 6, 2)
    assert at[..., 0] == pytest.approx(np.tile(np.arange(6) + 0.5, (4, 1)))
    assert at[..., 1] == pytest.approx(np.tile(np.arange(4)[:, None] + 0.5, (1, 6)))
