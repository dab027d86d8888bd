# SPDX-License-Identifier: Apache-2.0
"""Ruts in pictures are where rays meet them, and seen."""

import numpy as np
import pytest
from numpy.typing import NDArray

from groundlink.core.frames import Floats
from groundlink.scenario import Scenario
from groundlink.scenario.every_sensor import Mount
from groundlink.world.ruts import TILE, RutGrid
from groundlink.world.terrain import load_ground
from services.sensors.rays.replica import Replica
from services.sensors.rendering.gl import ground_ruts
from services.sensors.rendering.gl.pinhole import Pinhole
from services.sensors.rendering.gl.renderer import Renderer
from services.sensors.rendering.gl.target import ALL_LAYERS
from tests.services.sensors.rays.soft_ground import grooves, soft_scenario
from tests.services.sensors.rendering import views

PINHOLE = Pinhole(320, 240, 200.0, 200.0, 159.5, 119.5)


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return soft_scenario()


@pytest.fixture(scope="module")
def drawn(scenario: Scenario) -> Renderer:
    return views.renderer(scenario, PINHOLE, layers=ALL_LAYERS)


def grid_of(scenario: Scenario, seed: int | None = 2) -> RutGrid:
    assert scenario.world.terrain
    grid = RutGrid(*load_ground(scenario.world.terrain).grid)
    if seed is not None:
        grid.put(grooves(grid, seed))
    return grid


def cast(scenario: Scenario, ruts: RutGrid, pose: Floats) -> NDArray[np.float32]:
    """Return the depth of each pixel by rays."""
    replica = Replica(scenario, scenario.vehicles[0], Mount((0.0, 0.0, 50.0)))
    assert replica.ruts
    assert replica._relief
    tiles = b"".join(ruts.tile(number) for number in range(ruts.count))
    replica.ruts.put(np.frombuffer(tiles, TILE))
    replica._relief.deepen()
    parked = views.parked(views.world_replica(scenario), (0.0, 0.0, -400.0))
    replica.scene.move(np.stack([parked, parked]))
    rays = np.moveaxis(PINHOLE.rays() @ pose[:3, :3].T, -1, 0).astype(np.float32)
    origins = np.broadcast_to(pose[:3, 3, None, None], rays.shape).astype(np.float32)
    hits = replica.scene.cast(origins, rays, np.zeros(rays.shape[1:], np.float32), 1e5)
    return hits.range_m.copy()


@pytest.mark.parametrize(
    ("at_m", "yaw_deg", "pitch_deg"),
    [((0.0, 0.0, 1.5), 30.0, 40.0), ((-4.0, -3.0, 1.0), 45.0, 15.0), ((-9.0, 0.0, 2.0), 0.0, 15.0)],
)
def test_depth_is_that_of_rays(
    scenario: Scenario,
    drawn: Renderer,
    at_m: tuple[float, float, float],
    yaw_deg: float,
    pitch_deg: float,
) -> None:
    pose, ruts = views.looking(at_m, yaw_deg=yaw_deg, pitch_deg=pitch_deg), grid_of(scenario)
    drawn.press(ruts)
    seen = drawn.draw(pose)
    expected = cast(scenario, ruts, pose)
    drawn.press(grid_of(scenario, None))
    level = drawn.draw(pose)
    assert (np.isfinite(seen.depth_m) == np.isfinite(expected)).mean() > 0.99
    both = np.isfinite(seen.depth_m) & np.isfinite(expected)
    apart = np.abs(seen.depth_m[both] - expected[both])
    assert np.median(apart) < 1e-5
    assert (apart > 0.02).mean() < 0.01  # at edges of what is in front
    assert (np.abs(level.depth_m[both] - expected[both]) > 0.02).mean() > 0.05
    changed = np.abs(seen.color.astype(int) - level.color).max(axis=-1) > 8
    assert changed.mean() > 0.01
    assert np.mean(seen.labels == level.labels) > 0.999


def test_a_picture_follows_from_pose_and_ruts_alone(scenario: Scenario, drawn: Renderer) -> None:
    here = views.looking((0.0, 0.0, 1.5), yaw_deg=30.0, pitch_deg=40.0)
    there = views.looking((-4.0, -3.0, 1.0), yaw_deg=45.0, pitch_deg=15.0)
    drawn.press(grid_of(scenario))
    first = drawn.draw(here).color.copy()
    drawn.draw(there)
    drawn.press(grid_of(scenario, 5))
    other = drawn.draw(here).color.copy()
    drawn.press(grid_of(scenario))
    assert drawn.draw(here).color.tobytes() == first.tobytes()
    assert first.tobytes() != other.tobytes()
    drawn.press(grid_of(scenario, None))
    level = drawn.draw(here)
    again = views.renderer(scenario, PINHOLE, layers=ALL_LAYERS).draw(here)
    assert level.color.tobytes() == again.color.tobytes()
    assert level.depth_m.tobytes() == again.depth_m.tobytes()


def test_far_cells_and_too_many_stay_as_on_the_map(
    scenario: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert scenario.world.terrain
    ground, ruts = load_ground(scenario.world.terrain), grid_of(scenario)
    whole = ground_ruts.pressed_ground(ground, ruts, (6, 6), None)
    assert len(whole.rows) > 15
    monkeypatch.setattr(ground_ruts, "REACH_M", 2.0)
    near = ground_ruts.pressed_ground(ground, ruts, (6, 6), None)
    assert 0 < len(near.rows) < len(whole.rows)
    assert np.abs([near.rows - 6, near.columns - 6]).max() == 2
    monkeypatch.setattr(ground_ruts, "MOST_TRIANGLES", 2 * 800)
    few = ground_ruts.pressed_ground(ground, ruts, (6, 6), None)
    assert list(few.rows) == list(near.rows[:2])
    beside = ground_ruts.pressed_ground(ground, ruts, (60, -6), None)
    assert len(beside.rows) == 0
