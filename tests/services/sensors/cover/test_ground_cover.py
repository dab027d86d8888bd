# SPDX-License-Identifier: Apache-2.0
"""LiDARs see the glint of water, and leaves of grass as the law of Beer and Lambert says."""

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.loader.material_library import soil_library
from groundlink.scenario import Scenario
from groundlink.scenario.schema import Placement
from groundlink.scene.bodies import body_names
from groundlink.world.cover import GrassArea, WaterArea
from groundlink.world.ruts import TILE
from groundlink.world.solids import Material, Soil
from services.sensors.cover.ground_cover import mean_square_slope
from services.sensors.scanning.returns import Returns
from tests.services.physics.terrains import terrain
from tests.services.sensors.lidar import rooms
from tests.services.sensors.scanning.targets import measured, scanner, wall
from tests.services.sensors.scanning.targets import scenario as around

HEIGHT_M = 1.0
"""Of the sensor above the ground, which is at -1 m."""

MEADOW = GrassArea(ground=("soil",), height_m=(2.0, 2.0), leaf_area_density_per_m=0.4)


@pytest.fixture(autouse=True)
def _store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GROUNDLINK_ASSETS", str(tmp_path))


def field(*solids: Any, water: Any = (), grass: Any = (), **lidar: Any) -> Scenario:
    """Return a sensor over level ground of 81 x 81 m with this cover."""
    made = around(*solids, max_range_m=100.0, **lidar)
    soil = terrain(np.full((82, 82), -HEIGHT_M), materials=["soil"])
    known = {"soil": Material(0.3), "water": Material(0.03), "grass": Material(0.5)}
    materials = made.world.materials | known
    world = replace(made.world, terrain=soil, water=water, grass=grass, materials=materials)
    return replace(made, world=world)


def pool(level_m: float, **fields: Any) -> WaterArea:
    return WaterArea(level_m=level_m, low_m=(-30.0, -30.0), high_m=(30.0, 30.0), **fields)


def down(*angles_deg: float) -> dict[str, Any]:
    """Return lasers so far from the vertical, aimed along x."""
    return {"elevations_deg": [float(angle) - 90.0 for angle in angles_deg]}


def seen(made: Returns) -> tuple[np.ndarray, np.ndarray]:
    return made.returned[0], made.true_range_m[0]


def test_water_returns_near_the_vertical_alone_and_hides_the_ground() -> None:
    angles = (1.0, 5.0, 12.0, 20.0, 45.0, 70.0)
    returned, range_m = seen(measured(field(water=(pool(-0.75),), **down(*angles))))
    assert [bool(row.all()) for row in returned] == [True, True, True, False, False, False]
    assert not returned[3:].any()
    assert np.allclose(range_m[:3, 0], 0.75 / np.cos(np.radians(angles[:3])), atol=1e-4)


def test_the_glint_is_that_of_slopes_by_wind() -> None:
    angles = np.array([0.0, 4.0, 8.0])
    for wind in (1.0, 6.0):
        water = pool(-0.75, wind_mps=wind)
        made = measured(field(water=(water,), intensity="received", **down(*angles)))
        s2, t = mean_square_slope(water), np.radians(angles)
        share = 0.02 / (4 * s2 * np.cos(t) ** 5) * np.exp(-(np.tan(t) ** 2) / s2)
        power = 100 * np.minimum(share, 1) * (10 * np.cos(t) / 0.75) ** 2
        assert np.allclose(made.intensity[0, :, 0], power, rtol=2e-3)


def test_ground_above_the_level_is_dry() -> None:
    dry = measured(field(**down(30.0)))
    wet = measured(field(water=(pool(-1.2),), **down(30.0)))
    assert all(np.array_equal(*pair) for pair in zip(dry, wet, strict=True))


def test_rays_pass_so_far_through_grass() -> None:
    """Level rays within the grass, and a wall 10 m ahead."""
    made = measured(field(wall("white", 10.0), grass=(MEADOW,)))
    returned, range_m = seen(made)
    assert returned.all()
    in_grass = range_m < 9.99
    through = np.exp(-0.5 * 0.4 * 10.0)
    error = 4 * np.sqrt(through / range_m.size)
    assert 1 - in_grass.mean() == pytest.approx(through, abs=error)
    for distance in (1.0, 3.0, 6.0):
        share = np.exp(-0.5 * 0.4 * distance)
        assert (range_m > distance).mean() == pytest.approx(share, abs=4 / np.sqrt(range_m.size))
    assert 25 < made.intensity[0][in_grass].mean() < 40  # 50 % at 2/3, the mean of the cosine


def test_grass_is_drawn_for_each_ray_by_seed_and_revolution() -> None:
    one, again, other = (seen(measured(field(grass=(MEADOW,), seed=seed)))[1] for seed in (1, 1, 2))
    assert np.array_equal(one, again)
    assert not np.array_equal(one, other)


def test_blocks_hold_the_grass_of_the_whole_revolution() -> None:
    made = field(grass=(MEADOW,))
    sensor = scanner(made)
    for state in rooms.states(made, lambda _: ((0.0, 0.0, -HEIGHT_M), (0.0, 0.0, 0.0)), 2):
        sensor.replica.take(state)
    whole = sensor.measure(0, range(sensor.sweep.seconds.shape[1])).returns
    part = sensor.measure(0, range(400, 700)).returns
    assert np.array_equal(part.true_range_m, whole.true_range_m[..., 400:700])


def test_rays_above_the_grass_and_beside_it_meet_none() -> None:
    low = replace(MEADOW, height_m=(0.5, 0.5))
    assert not seen(measured(field(grass=(low,))))[0].any()
    beside = replace(MEADOW, low_m=(-30.0, 5.0), high_m=(30.0, 30.0))
    plain, made = measured(field(**down(40.0))), measured(field(grass=(beside,), **down(40.0)))
    assert np.array_equal(plain.true_range_m, made.true_range_m)


def test_rays_down_to_the_ground_meet_grass_from_its_top_on() -> None:
    tufts = replace(MEADOW, height_m=(0.2, 0.6), leaf_area_density_per_m=20.0)
    _, range_m = seen(measured(field(grass=(tufts,), **down(60.0))))
    height = HEIGHT_M - range_m * np.cos(np.radians(60.0))
    assert height.max() < 0.6
    assert 0.1 < height.mean() < 0.5
    assert (height > 0.25).any()
    assert (height < 0.15).any()


def test_several_rays_of_a_beam_give_leaves_and_the_wall_behind() -> None:
    spec = {"rays_per_beam": 16, "divergence_mrad": [3.0, 3.0], "returns": "dual"}
    made = measured(field(wall("white", 8.0), grass=(MEADOW,), **spec))
    both = made.returned.all(axis=0)
    assert both.mean() > 0.5
    assert (made.true_range_m[0][both] > made.true_range_m[1][both]).any()


def test_a_vehicle_bends_grass_to_its_clearance() -> None:
    made = field(grass=(MEADOW,), **down(80.0))
    model = made.vehicles[0].model
    long = replace(model.chassis, size_m=(12.0, 12.0, 0.1), center_m=(0.0, 0.0, 0.2))
    rover = replace(made.vehicles[0], model=replace(model, chassis=long), placement=Placement())
    _, range_m = seen(measured(replace(made, vehicles=(rover,))))
    # Its chassis is 0.25 m above the ground, to which a ray comes down in 4.3 m.
    assert range_m.min() > 0.75 / np.cos(np.radians(80.0)) - 0.1
    assert seen(measured(made))[1].min() < 0.5


def test_grass_lies_in_ruts() -> None:
    made = field(grass=(MEADOW,), **down(60.0))
    soft = replace(made.world.materials["soil"], soil=msgspec.convert(soil_library()["snow"], Soil))
    world = replace(made.world, materials=made.world.materials | {"soil": soft})
    sensor = scanner(replace(made, world=world))
    ruts = sensor.replica.ruts
    assert ruts is not None
    for state in rooms.states(made, lambda _: ((0.0, 0.0, -HEIGHT_M), (0.0, 0.0, 0.0)), 2):
        sensor.replica.take(state)
    everywhere = range(sensor.sweep.seconds.shape[1])
    standing = sensor.measure(0, everywhere).returns.true_range_m
    tiles = np.zeros(ruts.tile_columns**2, TILE)
    tiles["key"], tiles["depths"] = np.arange(len(tiles)), 1
    ruts.put(tiles)
    lying = sensor.measure(0, everywhere).returns.true_range_m
    assert (standing < 1.9).any()
    assert lying.min() > 1.9


def test_cover_belongs_to_the_terrain_and_has_materials_of_its_own() -> None:
    made = field(water=(pool(-0.75),), grass=(MEADOW,), **down(2.0))
    sensor = scanner(made)
    replica = sensor.replica
    count = len(replica.static)
    assert replica.materials[count : count + 3] == ["soil", "water", "grass"]
    labels = np.arange(count, count + 3, dtype=np.int32)
    numbers = replica.body_numbers(labels, np.full(3, -1, np.int32))
    names = body_names(made, replica.static)
    assert [names[number] for number in numbers] == ["terrain"] * 3
