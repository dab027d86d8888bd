# SPDX-License-Identifier: Apache-2.0
"""Worlds of terrain and shipped vehicles on them."""

from collections.abc import Sequence

import numpy as np
from msgspec.structs import replace
from numpy.typing import ArrayLike, NDArray

from groundlink.scenario import Scenario
from groundlink.scenario.schema import Placement
from groundlink.scenario.vehicle import VehicleModel
from groundlink.world import assets
from groundlink.world.solids import Material, Solid
from groundlink.world.terrain import Terrain, encode_grid
from services.physics.simulation.simulation import Simulation
from services.physics.trials.track import NAME

from .grounds import plain_scenario


def terrain(
    heights: ArrayLike,
    cell_m: float = 1.0,
    *,
    at_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    surface: NDArray[np.uint8] | None = None,
    materials: Sequence[str] = ("ground",),
) -> Terrain:
    """Return terrain with its assets in the store."""
    heights = np.ascontiguousarray(heights, np.float32)
    half = (np.array(heights.shape)[::-1] - 1) * cell_m / 2
    low = (at_m[0] - half[0], at_m[1] - half[1], at_m[2] + heights.min())
    high = (at_m[0] + half[0], at_m[1] + half[1], at_m[2] + heights.max())
    return Terrain(
        heights=assets.put(encode_grid(heights)),
        surface=None if surface is None else assets.put(encode_grid(surface)),
        cell_m=cell_m,
        at_m=at_m,
        low_m=tuple(map(float, low)),
        high_m=tuple(map(float, high)),
        materials=tuple(materials),
    )


def world(
    described: Terrain | None,
    *placed: tuple[VehicleModel, Placement],
    materials: dict[str, Material] | None = None,
) -> Scenario:
    """Return a scenario of vehicles on terrain: the first is `NAME`, others `NAME` and a number."""
    empty = plain_scenario()
    known = empty.world.materials | (materials or {})
    for model, _ in placed:
        known = known | model.materials
    vehicles = tuple(
        replace(empty.vehicles[0], name=f"{NAME}{i or ''}", model=model, placement=place)
        for i, (model, place) in enumerate(placed)
    )
    bare = replace(empty.world, room=None, furniture=(), solids=(), clutter=None, checkpoints={})
    return replace(
        empty, vehicles=vehicles, world=replace(bare, terrain=described, materials=known)
    )


def put(
    described: Terrain | None,
    model: VehicleModel,
    *extra: Solid,
    at: Placement = Placement(),  # noqa: B008 - frozen
    materials: dict[str, Material] | None = None,
) -> Simulation:
    """Return a simulation of one vehicle on terrain."""
    return Simulation(world(described, (model, at), materials=materials), extra)


def hills(count: int, *, seed: int = 0, steepest: float = 0.3, cell_m: float = 1.0) -> NDArray:
    """Return rolling heights, shape (count, count), by a sum of waves of 15 cells or longer."""
    random = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(count), np.arange(count))
    heights = np.zeros((count, count))
    for _ in range(12):
        along, across = random.normal(0, 2 * np.pi / 40, 2)
        heights += np.sin(along * x + across * y + random.uniform(0, 2 * np.pi))
    steep = max(np.abs(np.diff(heights, axis=axis)).max() for axis in (0, 1))
    return (heights * steepest * cell_m / steep).astype(np.float32)
