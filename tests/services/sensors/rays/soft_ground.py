# SPDX-License-Identifier: Apache-2.0
"""Soft terrain with a groove."""

import numpy as np
from numpy.typing import NDArray

from groundlink.messages.base import Ruts
from groundlink.scenario import Scenario
from groundlink.scenario.schema import Placement
from groundlink.world.ruts import NO_RUTS, SIDE, TILE, RutGrid, digest_of, split
from groundlink.world.solids import Material
from tests.services.physics.grounds import SOILS, shipped
from tests.services.physics.terrains import terrain, world

CELLS = 12


def soft_scenario() -> Scenario:
    """Return a rover on rough terrain of soil."""
    heights = np.random.default_rng(1).normal(0.0, 0.1, (CELLS + 1, CELLS + 1))
    materials = {"ground": Material(soil=SOILS["dry_sand"])}
    placed = shipped("rover"), Placement(x_m=-5.0, y_m=-5.0)
    return world(terrain(heights), placed, materials=materials)


def grooves(grid: RutGrid, seed: int) -> NDArray[np.void]:
    """Return tiles with a groove across the map: its depth at each vertex is any."""
    row, column = np.indices((grid.rows, grid.columns))
    depths = np.where(
        np.abs(row - column - 20) < 8, np.random.default_rng(seed).integers(1, 1500, row.shape), 0
    )
    sides = [-(-n // SIDE) * SIDE for n in depths.shape]
    whole = np.zeros(sides, np.uint16)
    whole[: grid.rows, : grid.columns] = depths
    blocks = whole.reshape(sides[0] // SIDE, SIDE, -1, SIDE).swapaxes(1, 2).reshape(-1, SIDE, SIDE)
    [used] = np.nonzero(blocks.any(axis=(1, 2)))
    tiles = np.zeros(len(used), TILE)
    tiles["key"], tiles["depths"] = used, blocks[used]
    return tiles


def all_of(tiles: NDArray[np.void]) -> Ruts:
    content = tiles.tobytes()
    return Ruts(digest_of(split(content)), NO_RUTS, memoryview(content))
