# SPDX-License-Identifier: Apache-2.0
"""Worlds with terrain, for tests of pictures."""

import numpy as np
from msgspec.structs import replace
from numpy.typing import ArrayLike, NDArray

from groundlink.scenario.schema import Placement, Scenario
from groundlink.world import assets
from groundlink.world.solids import Material, Solid
from groundlink.world.terrain import Terrain, encode_grid
from groundlink.world.weather import Lamps, Sun
from tests.services.sensors.yards import yard

MATERIALS = {
    "grass": Material(color=(0.05, 0.30, 0.04), texture="grass"),
    "sand": Material(color=(0.45, 0.10, 0.05), texture="soil"),
}


def waves(rows: int, columns: int, *, high: float, long: float) -> NDArray[np.float32]:
    """Return hills and dales, and small bumps on them; lengths in cells."""
    y, x = np.indices((rows, columns)) * (2 * np.pi / long)
    made = np.sin(x + 1.0) * np.cos(1.3 * y) + 0.2 * np.sin(4.1 * x + 2.2 * y)
    made += 0.001 * np.random.default_rng(3).standard_normal((rows, columns))
    return (high * made).astype(np.float32)


def hilly(
    heights: ArrayLike,
    *solids: Solid,
    cell_m: float = 1.0,
    surface: ArrayLike | None = None,
    light: Sun | Lamps | None = None,
) -> Scenario:
    """Return a world of terrain around the origin; its vehicle is far above."""
    heights = np.ascontiguousarray(heights, np.float32)
    rows, columns = heights.shape
    if surface is None:
        surface = np.zeros((rows - 1, columns - 1), np.uint8)
    east, north = (columns - 1) * cell_m / 2, (rows - 1) * cell_m / 2
    terrain = Terrain(
        heights=assets.put(encode_grid(heights)),
        surface=assets.put(encode_grid(np.asarray(surface, np.uint8))),
        cell_m=cell_m,
        at_m=(0.0, 0.0, 0.0),
        low_m=(-east, -north, float(heights.min())),
        high_m=(east, north, float(heights.max())),
        materials=tuple(MATERIALS),
    )
    made = yard(*solids)
    materials = {**made.world.materials, **MATERIALS}
    world = replace(made.world, solids=solids, materials=materials, terrain=terrain, light=light)
    high = replace(made.vehicles[0], placement=Placement(z_m=1000.0))
    return replace(made, world=world, vehicles=(high,))
