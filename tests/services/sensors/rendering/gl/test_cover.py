# SPDX-License-Identifier: Apache-2.0
"""Standing water and tall grass in pictures."""

from typing import Any

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray

from groundlink.loader.material_library import soil_library
from groundlink.scenario.schema import Scenario
from groundlink.world.cover import GrassArea, WaterArea, tuft_draws
from groundlink.world.ruts import TILE, RutGrid
from groundlink.world.solids import Material, Soil
from groundlink.world.terrain import load_ground
from services.sensors.rendering.gl.pinhole import Pinhole
from services.sensors.rendering.gl.renderer import Renderer
from services.sensors.rendering.gl.target import ALL_LAYERS, Frame
from tests.services.physics.grounds import shipped
from tests.services.sensors.rendering import views
from tests.services.sensors.rendering.hilly import hilly

LAYERS = (*ALL_LAYERS, "soils")
PINHOLE = Pinhole(160, 120, 100.0, 100.0, 79.5, 59.5)
DOWN = views.looking((0.0, 0.0, 4.0), pitch_deg=90.0)
MEADOW = GrassArea(ground=("grass",), height_m=(0.8, 1.0))
BLUE = {"water": Material(color=(0.01, 0.02, 0.3))}


def level(**cover: Any) -> Scenario:
    """Return level ground with cover."""
    made = hilly(np.zeros((60, 60)))
    materials = {**made.world.materials, **BLUE}
    return replace(made, world=replace(made.world, materials=materials, **cover))


def renderer(scenario: Scenario) -> Renderer:
    return views.renderer(scenario, PINHOLE, layers=LAYERS)


def drawn(scenario: Scenario, pose: NDArray[np.float64] = DOWN) -> Frame:
    made = renderer(scenario)
    try:
        return made.draw(pose)
    finally:
        made.close()


def pool(level_m: float) -> WaterArea:
    return WaterArea(level_m=level_m, low_m=(-20.0, -20.0), high_m=(20.0, 0.0))


def test_water_covers_the_ground_as_far_as_it_reaches() -> None:
    frame = drawn(level(water=(pool(0.5),)))
    # Looking down along x, the image's left is north.
    dry, wet = frame.depth_m[:, :75], frame.depth_m[:, 85:]
    assert np.allclose(dry, 4.0, atol=1e-3)
    assert np.allclose(wet, 3.5, atol=1e-3)
    red, _, blue = frame.color[:, 85:].reshape(-1, 3).mean(axis=0)
    assert blue > 2 * red
    assert frame.labels is not None
    assert len(np.unique(frame.labels)) == 2
    assert np.array_equal(drawn(level(water=(pool(-0.5),))).depth_m, drawn(level()).depth_m)


def test_grass_stands_on_its_ground_up_to_its_height() -> None:
    frame = drawn(level(grass=(MEADOW,)))
    height = 4.0 - frame.depth_m
    assert 0.5 < height.max() <= 1.0
    assert (height > 0.05).mean() > 0.4
    assert frame.labels is not None
    assert len(np.unique(frame.labels)) == 2
    sandy = replace(MEADOW, ground=("sand",))
    assert np.array_equal(drawn(level(grass=(sandy,))).depth_m, drawn(level()).depth_m)


def test_the_same_place_has_the_same_grass_whatever_was_drawn_before() -> None:
    made = renderer(level(grass=(MEADOW,)))
    first = made.draw(DOWN)
    made.draw(views.looking((12.0, -3.0, 1.5), yaw_deg=40.0))
    again = made.draw(DOWN)
    made.close()
    assert np.array_equal(first.color, again.color)
    assert np.array_equal(first.depth_m, again.depth_m)


def test_far_grass_is_thinner_and_wider() -> None:
    """About as much of the ground is hidden from everywhere, as seen from above."""
    shares = []
    for up in (5.0, 25.0):
        pose = views.looking((0.0, 0.0, up), pitch_deg=90.0)
        shares.append((up - drawn(level(grass=(MEADOW,)), pose).depth_m > 0.05).mean())
    assert min(shares) > 0.5 * max(shares)
    assert (
        drawn(level(grass=(MEADOW,)), views.looking((0, 0, 70), pitch_deg=90.0)).depth_m > 69.9
    ).all()


def test_a_vehicle_bends_the_grass_under_it() -> None:
    scenario, rover = level(grass=(MEADOW,)), shipped("rover")
    world = replace(scenario.world, materials=scenario.world.materials | rover.materials)
    vehicle = replace(scenario.vehicles[0], model=rover)
    scenario = replace(scenario, world=world, vehicles=(vehicle,))
    around = views.world_replica(scenario)
    made = Renderer(scenario.world, around, PINHOLE, layers=LAYERS)
    views_of = []
    for z_m in (0.2, -400.0):
        made.place(views.parked(around, (0.0, 0.0, z_m)))
        views_of.append(4.0 - made.draw(DOWN).depth_m[54:66, 74:86])
    made.close()
    with_it, without = views_of
    # Its deck is in the middle of the picture, and no blade is before it.
    assert np.ptp(with_it) < 0.5
    assert (with_it > 0.2).all()
    assert (without < 0.1).any()


def test_tufts_have_heights_by_place_as_rays_meet_them() -> None:
    x, y = np.mgrid[-50:50, -50:50].reshape(2, -1)
    draws = tuft_draws(x, y)
    assert np.array_equal(draws, tuft_draws(x, y))
    assert draws.min() >= 0.0
    assert draws.max() < 1.0
    assert draws.mean() == pytest.approx(0.5, abs=0.02)
    assert np.std(draws) == pytest.approx(np.sqrt(1 / 12), abs=0.01)


def test_grass_lies_in_ruts() -> None:
    made = level(grass=(MEADOW,))
    soft = replace(
        made.world.materials["grass"], soil=msgspec.convert(soil_library()["snow"], Soil)
    )
    world = replace(made.world, materials=made.world.materials | {"grass": soft})
    assert world.terrain
    ruts = RutGrid(*load_ground(world.terrain).grid)
    # North of the middle, which is left in the picture.
    rows = np.arange(ruts.tile_columns // 2 + 1, ruts.tile_columns // 2 + 5)
    columns = np.arange(ruts.tile_columns // 2 - 3, ruts.tile_columns // 2 + 4)
    tiles = np.zeros(len(rows) * len(columns), TILE)
    tiles["key"] = (rows[:, None] * ruts.tile_columns + columns).ravel()
    tiles["depths"] = 1
    ruts.put(tiles)
    drawing = renderer(replace(made, world=world))
    drawing.draw(DOWN)
    drawing.press(ruts)
    height = 4.0 - drawing.draw(DOWN).depth_m
    drawing.close()
    assert height[:, :30].max() < 0.5 < height[:, 100:].max()
    assert np.median(height[:, :30].max(axis=1)) < 0.1
