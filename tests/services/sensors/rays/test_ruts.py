# SPDX-License-Identifier: Apache-2.0
"""Rays meet the ruts of soft terrain where these are, from the tick on at which they are made."""

import numpy as np
import pytest
from msgspec import UNSET, UnsetType
from numpy.typing import NDArray

from groundlink.messages.base import BadBusMessage, Ruts, State, VehicleState, packed
from groundlink.scenario import Scenario
from groundlink.scenario.every_sensor import Mount
from groundlink.world.ruts import SIDE, STEP_M, RutGrid
from groundlink.world.terrain import Ground, load_ground
from services.sensors.rays.replica import Replica

from .soft_ground import CELLS, all_of, grooves, soft_scenario


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return soft_scenario()


def grid_of(replica: Replica) -> RutGrid:
    assert replica.ruts
    return replica.ruts


def state(replica: Replica, tick: int, ruts: Ruts | UnsetType) -> State:
    poses = np.tile([-5.0, -5.0, 0.5, 0.0, 0.0, 0.0, 1.0], (len(replica.links), 1))
    nothing = memoryview(b"")
    vehicle = VehicleState(packed(poses), packed(np.zeros(6)), nothing, nothing)
    [name] = {*replica.movers}
    return State("run", 0, 0, tick, tick * 2_500_000, "", {name: vehicle}, nothing, ruts)


def surface(ground: Ground, tiles: NDArray[np.void], x: NDArray, y: NDArray) -> NDArray:
    """Return the heights of the pressed ground, on the triangles of the refined grid."""
    rows = -(-(20 * CELLS + 1) // SIDE)
    depths = np.zeros((rows * SIDE, rows * SIDE))
    for tile in tiles:
        i, j = (SIDE * n for n in divmod(int(tile["key"]), rows))
        depths[i : i + SIDE, j : j + SIDE] = tile["depths"] * STEP_M
    u, v = ((at - first) / 0.05 for at, first in ((x, ground.x0_m), (y, ground.y0_m)))
    i, j = np.floor(u).astype(int), np.floor(v).astype(int)
    u, v = u - i, v - j
    a, b, c, d = depths[j, i], depths[j, i + 1], depths[j + 1, i], depths[j + 1, i + 1]
    south_west = a + u * (b - a) + v * (c - a)
    north_east = d + (1 - u) * (c - d) + (1 - v) * (b - d)
    return ground.height_at(x, y) - np.where(u + v <= 1, south_west, north_east)


def cast(
    replica: Replica, origins: NDArray, directions: NDArray
) -> tuple[NDArray, NDArray, NDArray]:
    """Return the hits on the map, the normals there, and where these rays begin."""
    far_away = np.tile([0.0, 0.0, 100.0, 0.0, 0.0, 0.0, 1.0], (2, len(replica.links), 1))
    replica.scene.move(far_away)
    count = origins.shape[1]
    rays = origins.astype(np.float32), directions.astype(np.float32)
    hits = replica.scene.cast(*rays, np.zeros(count, np.float32), 100.0)
    points = rays[0] + rays[1].astype(np.float64) * hits.range_m
    met = np.isfinite(hits.range_m) & (np.abs(points[:2]) < CELLS / 2 - 0.1).all(axis=0)
    return points[:, met], hits.normal_in_world[:, met].copy(), origins[:, met]


def rays(count: int, steepest_deg: float) -> tuple[NDArray, NDArray]:
    """Return rays that come down from above the map at any angle."""
    random = np.random.default_rng(3)
    azimuth = random.uniform(0.0, 2 * np.pi, count)
    up = np.radians(random.uniform(-steepest_deg, -3.0, count))
    origins = random.uniform([-5.0, -5.0, 0.6], [5.0, 5.0, 1.2], (count, 3)).T
    directions = [np.cos(azimuth) * np.cos(up), np.sin(azimuth) * np.cos(up), np.sin(up)]
    return origins, np.stack(directions)


@pytest.mark.parametrize("steepest_deg", [10.0, 90.0])
def test_rays_meet_the_bottom_of_ruts(scenario: Scenario, steepest_deg: float) -> None:
    replica = Replica(scenario, scenario.vehicles[0], Mount((0.0, 0.0, 0.5)))
    tiles = grooves(grid_of(replica), 2)
    replica.take(state(replica, 0, all_of(tiles)))
    assert replica.press(0)
    assert scenario.world.terrain
    ground = load_ground(scenario.world.terrain)
    origins, directions = rays(3000, steepest_deg)
    points, normals, _ = cast(replica, origins, directions)
    x, y, z = points
    assert np.abs(surface(ground, tiles, x, y) - z).max() < 2e-6
    deep = ground.height_at(x, y) - z > 0.01
    assert np.count_nonzero(deep) > 30
    # The normal is that of the surface at the hit.
    step = 1e-5
    slopes = [
        (surface(ground, tiles, x + dx, y + dy) - surface(ground, tiles, x - dx, y - dy)) / 2 / step
        for dx, dy in ((step, 0.0), (0.0, step))
    ]
    expected = np.stack([-slopes[0], -slopes[1], np.ones_like(z)])
    expected /= np.linalg.norm(expected, axis=0)
    near = np.linalg.norm(normals - expected, axis=0) < 1e-3
    assert near.mean() > 0.99  # the others are at edges


def test_no_ray_passes_through_the_walls_of_ruts(scenario: Scenario) -> None:
    replica = Replica(scenario, scenario.vehicles[0], Mount((0.0, 0.0, 0.5)))
    tiles = grooves(grid_of(replica), 2)
    replica.take(state(replica, 0, all_of(tiles)))
    replica.press(0)
    assert scenario.world.terrain
    ground = load_ground(scenario.world.terrain)
    points, _, starts = cast(replica, *rays(400, 20.0))
    for start, end in zip(starts.T, points.T, strict=True):
        way = start[:, None] + (end - start)[:, None] * np.linspace(0.0, 0.9999, 300)
        assert (way[2] - surface(ground, tiles, way[0], way[1])).min() > -1e-5


def test_ruts_come_with_their_tick_and_go_with_the_episode(scenario: Scenario) -> None:
    replica = Replica(scenario, scenario.vehicles[0], Mount((0.0, 0.0, 0.5)))
    first, second = all_of(grooves(grid_of(replica), 2)), all_of(grooves(grid_of(replica), 5))
    assert replica.ruts
    for tick, ruts in enumerate((UNSET, UNSET, first, Ruts(first.digest), second)):
        replica.take(state(replica, tick, ruts))
    assert not replica.press(1)
    assert replica.ruts.count == 0
    assert replica.press(3)
    assert not replica.press(3)
    before = replica.ruts.depths.copy()
    assert replica.press(4)
    assert not np.array_equal(before, replica.ruts.depths)
    replica.restart()
    replica.take(state(replica, 0, UNSET))
    assert replica.press(0)
    assert replica.ruts.count == 0


def test_a_rut_beside_the_map_is_refused(scenario: Scenario) -> None:
    replica = Replica(scenario, scenario.vehicles[0], Mount((0.0, 0.0, 0.5)))
    tiles = grooves(grid_of(replica), 2)
    tiles["key"][0] = 10**9
    with pytest.raises(BadBusMessage, match="beside the terrain"):
        replica.take(state(replica, 0, all_of(tiles)))
