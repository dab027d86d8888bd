# SPDX-License-Identifier: Apache-2.0
"""The true map against rays of a planar scanner: each ends in an occupied cell, and not before."""

from collections.abc import Callable

import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.importing.map_files import solids_of
from groundlink.importing.map_specs import OccupancyMapFile
from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.scenario import Scenario
from groundlink.scenario.schema import World
from groundlink.scene.build import solids
from groundlink.scene.true_map import default_heights_m, true_map
from groundlink.world.occupancy import FREE, OCCUPIED, MapGrid, OccupancyMap
from groundlink.world.triangles import merged
from services.sensors.rays.scene import Scene

RAYS = 720
NEAR_M = 2e-3
"""Overlaps below a millimeter are in no cell."""


def lab() -> Scenario:
    return load(SHIPPED / "indoor_2d.yaml")


TURNED = MapGrid(0.05, -2.0, -2.0, 0.3, 80, 100)


def mapped() -> Scenario:
    """Return a world of a turned map with walls of one cell."""
    cells = np.zeros((80, 100), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    draw = np.random.default_rng(5)
    for row, column in draw.integers(5, (75, 95), (60, 2)):
        cells[row, column : column + draw.integers(1, 6)] = OCCUPIED
    found = OccupancyMap(TURNED, cells)
    static = tuple(solids_of(found, OccupancyMapFile(file="it.yaml"), 0.65))
    materials = lab().world.materials
    return replace(lab(), world=World(name="it", solids=static, materials=materials))


@pytest.mark.parametrize(("made", "grid"), [(lab, None), (mapped, TURNED)])
def test_rays_of_a_scanner_end_in_the_first_occupied_cell(
    made: Callable[[], Scenario], grid: MapGrid | None
) -> None:
    scenario = made()
    static = solids(scenario)
    found = true_map(scenario, static, resolution_m=0.05, grid=grid)
    cells = found.grid
    height_m, _ = default_heights_m(scenario)
    free = np.argwhere(found.cells == FREE)
    within = free[(np.abs(free - np.array(found.cells.shape) / 2) < 35).all(axis=1)]
    chosen = within[np.random.default_rng(2).choice(len(within), 40)]
    eyes = cells.centers_m()[chosen[:, 0], chosen[:, 1]]
    angles = np.linspace(0, 2 * np.pi, RAYS, endpoint=False)
    ones = np.ones((len(eyes), RAYS), np.float32)
    along = np.stack([np.cos(angles) * ones, np.sin(angles) * ones, 0 * ones]).astype(np.float32)
    origins = np.stack([eyes[:, 0, None] * ones, eyes[:, 1, None] * ones, height_m * ones])
    hits = Scene(merged(static)).cast(origins.astype(np.float32), along, 0 * ones, 60.0)
    range_m = hits.range_m.astype(np.float64)
    met = np.isfinite(range_m)
    assert met.mean() > 0.9

    def cells_at(distance_m: np.ndarray, inwards_m: float = 0.0) -> np.ndarray:
        places = eyes[:, None] + distance_m[..., None] * np.moveaxis(along[:2], 0, -1)
        places = places - inwards_m * np.moveaxis(hits.normal_in_world[:2], 0, -1)
        at = np.floor(cells.in_cells(places.reshape(-1, 2)) + 1e-9).astype(int)
        inside = (at >= 0).all(axis=1) & (at < (cells.columns, cells.rows)).all(axis=1)
        column, row = np.where(inside[:, None], at, 0).T
        return np.where(inside, found.cells[row, column], FREE).reshape(distance_m.shape)

    # But for corners that reach less than a millimeter into a cell.
    assert (cells_at(np.where(met, range_m, 0.0), NEAR_M)[met] == OCCUPIED).mean() > 0.9998
    # Up to a cell's diagonal before the surface the cell may be that of the surface.
    before_m = np.where(met, range_m, 0.0) - 1.5 * cells.resolution_m
    for share in np.linspace(0, 1, 60):
        passed = np.where(before_m > 0, share * before_m, 0.0)
        blocked = (cells_at(passed) == OCCUPIED) & (before_m > 0)
        if grid is not None:
            # Walls fill their cells: a ray through an occupied cell ends there.
            assert not blocked.any()
        else:
            # A cell counts as a whole, so rays pass beside what is in its other part.
            assert blocked.mean() < 0.02
