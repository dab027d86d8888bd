# SPDX-License-Identifier: Apache-2.0
"""The true map: a map that became a world is the map of that world, cell by cell."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.importing.map_files import solids_of
from groundlink.importing.map_specs import OccupancyMapFile
from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.scenario.ros_side import TrueMap
from groundlink.scenario.schema import World
from groundlink.scene.build import WorldError, solids
from groundlink.scene.true_map import check_true_map, default_heights_m, true_map
from groundlink.world.occupancy import FREE, OCCUPIED, MapGrid, OccupancyMap
from groundlink.world.solids import Box, Solid


def drawn(rows: int, columns: int) -> np.ndarray:
    """Return random cells in patches, as a map has them, with a border of walls."""
    draw = np.random.default_rng(rows)
    cells = np.zeros((rows, columns), np.int8)
    for _ in range(25):
        row, column = draw.integers(0, (rows, columns))
        high, wide = draw.integers(1, 9, 2)
        cells[row : row + high, column : column + wide] = draw.choice([100, 100, -1, 0])
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    return cells


@pytest.mark.parametrize(
    "grid",
    [
        MapGrid(0.05, -1.35, 2.65, 0.0, 40, 60),
        MapGrid(0.05, 512.0, -300.0, 0.0, 33, 21),
        MapGrid(0.1, -3.21, 0.77, math.radians(33), 30, 45),
        MapGrid(0.025, 1.0, 2.0, math.pi / 2, 60, 30),
    ],
)
@pytest.mark.parametrize("heights_m", [(0.5, 0.5), (0.1, 1.0), (0.0, 2.5)])
def test_map_to_world_to_map_is_the_same(grid: MapGrid, heights_m: tuple[float, float]) -> None:
    given = OccupancyMap(grid, drawn(grid.rows, grid.columns))
    static = tuple(solids_of(given, OccupancyMapFile(file="it.yaml"), 0.65))
    world = World(name="it", solids=static)
    scenario = replace(load(SHIPPED / "indoor_2d.yaml"), world=world)
    found = true_map(scenario, static, resolution_m=9.0, heights_m=heights_m, grid=grid)
    assert (found.cells == given.cells).all()
    if not grid.yaw_rad and math.isclose(grid.x_m / 0.05 % 1 % 1, 0, abs_tol=1e-6):
        around = true_map(scenario, static, resolution_m=grid.resolution_m, heights_m=heights_m)
        assert (around.cells == given.cells).all()
        assert (around.grid.x_m, around.grid.y_m) == pytest.approx((grid.x_m, grid.y_m))


def test_heights_are_those_of_the_first_planar_scanner() -> None:
    planar = load(SHIPPED / "indoor_2d.yaml")
    rover = planar.vehicles[0]
    low_m, high_m = default_heights_m(planar)
    assert low_m == high_m == rover.model.base_height_m + 0.36
    assert default_heights_m(load(SHIPPED / "indoor_lab.yaml")) == (0.1, 1.0)


def test_the_lab_has_its_furniture_in_its_map_but_no_vehicle() -> None:
    lab = load(SHIPPED / "indoor_2d.yaml")
    found = true_map(lab, solids(lab), resolution_m=0.05)

    def at(x_m: float, y_m: float) -> int:
        column, row = found.grid.in_cells(np.array([[x_m, y_m]])).astype(int)[0]
        return int(found.cells[row, column])

    pillar, cabinet, wall = (0.2, 2.6), (4.9, 3.75), (0.0, 4.07)
    assert [at(*place) for place in (pillar, cabinet, wall)] == [OCCUPIED] * 3
    below_a_table, spawn = (-4.6, 3.55), (-4.6, 0.0)
    assert [at(*place) for place in (below_a_table, spawn)] == [FREE] * 2


def test_a_map_too_large_for_its_cells_is_refused() -> None:
    lab = load(SHIPPED / "indoor_2d.yaml")
    fine = replace(lab, true_map=TrueMap(resolution_m=0.001))
    with pytest.raises(WorldError, match=r"`true_map.resolution_m`: .* cells is too large"):
        check_true_map(fine, solids(fine))
    check_true_map(lab, [])
    check_true_map(replace(fine, true_map=TrueMap()), [Solid("a", Box(size_m=(1, 1, 1)), "m")])
