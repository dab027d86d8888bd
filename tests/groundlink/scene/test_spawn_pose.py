# SPDX-License-Identifier: Apache-2.0
"""Where vehicles stand at their start."""

import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.core.frames import matrix_from_quaternion, rpy_from_matrix
from groundlink.scenario.schema import Placement
from groundlink.scene.build import WorldError, solids
from groundlink.scene.spawn_checks import check_spawns, floor_problem
from groundlink.scene.spawn_pose import spawn_pose
from groundlink.world.solids import Box, Solid
from groundlink.world.terrain import Terrain, load_ground
from tests.services.physics.grounds import VEHICLES, shipped
from tests.services.physics.terrains import hills, terrain, world

PLACE = Placement(x_m=3.25, y_m=-7.4, yaw_deg=30.0)


def slope(along: float, across: float) -> Terrain:
    line = np.arange(81) - 40.0
    return terrain(along * line[None, :] + across * line[:, None], 1.0, at_m=(0.0, 0.0, 5.0))


@pytest.mark.parametrize("name", VEHICLES)
def test_on_flat_ground_it_stands_upright_above_its_place(name: str) -> None:
    model = shipped(name)
    place = replace(PLACE, z_m=0.5)
    vehicle = world(None, (model, place)).vehicles[0]
    origin, turn = spawn_pose(vehicle, None)
    assert origin == (3.25, -7.4, 0.5 + model.base_height_m)
    assert turn == pytest.approx((0.0, 0.0, np.sin(np.pi / 12), np.cos(np.pi / 12)))
    on_terrain = spawn_pose(vehicle, load_ground(terrain(np.zeros((41, 41)))))
    np.testing.assert_allclose(np.concatenate(on_terrain), [*origin, *turn], atol=1e-12)


@pytest.mark.parametrize("name", VEHICLES)
@pytest.mark.parametrize("yaw_deg", [0.0, 30.0, 135.0, -90.0])
@pytest.mark.parametrize(("along", "across"), [(0.3, 0.0), (0.0, 0.3), (0.2, -0.25)])
def test_on_a_slope_all_wheels_touch_and_it_faces_where_it_is_told(
    name: str, yaw_deg: float, along: float, across: float
) -> None:
    model = shipped(name)
    place = replace(PLACE, yaw_deg=yaw_deg)
    vehicle = world(None, (model, place)).vehicles[0]
    origin, turn = spawn_pose(vehicle, load_ground(slope(along, across)))
    rotation = matrix_from_quaternion(turn)
    normal = np.array([-along, -across, 1.0]) / np.sqrt(1 + along**2 + across**2)
    for wheel in model.wheels:
        hub = rotation @ wheel.center_m + origin - (0, 0, 5.0)
        if model.stands_on(wheel):
            assert hub @ normal == pytest.approx(wheel.radius_m, abs=1e-6)
    assert rpy_from_matrix(rotation)[2] == pytest.approx(np.radians(yaw_deg))
    footprint = np.array(origin) - rotation[:, 2] * model.base_height_m
    assert footprint[:2] == pytest.approx((place.x_m, place.y_m), abs=1e-6)


@pytest.mark.parametrize("name", VEHICLES)
def test_on_rough_ground_no_wheel_is_in_it_and_one_touches(name: str) -> None:
    random = np.random.default_rng(0)
    here = load_ground(terrain(hills(81) + random.normal(0, 0.2, (81, 81)), 1.0))
    model = shipped(name)
    for _ in range(20):
        x, y = random.uniform(-30, 30, 2).tolist()
        place = Placement(x_m=x, y_m=y, yaw_deg=float(random.uniform(-180, 180)))
        origin, turn = spawn_pose(world(None, (model, place)).vehicles[0], here)
        rotation = matrix_from_quaternion(turn)
        gaps = []
        for wheel in model.wheels:
            hub = rotation @ wheel.center_m + origin
            turns, out = np.meshgrid(np.linspace(0, 2 * np.pi, 25), np.linspace(0, 1, 11))
            dx, dy = wheel.radius_m * out * (np.cos(turns), np.sin(turns))
            low = hub[2] - np.sqrt(np.maximum(wheel.radius_m**2 - dx**2 - dy**2, 0))
            gaps.append(float((low - here.height_at(hub[0] + dx, hub[1] + dy)).min()))
        # Between the places that are looked at there may be a ridge.
        assert min(gaps) > -0.03
        x, y = np.meshgrid(np.linspace(-4, 4, 33), np.linspace(-4, 4, 33))
        around = here.height_at(origin[0] + x, origin[1] + y)
        assert origin[2] < around.max() + 1.2 * model.base_height_m


def test_how_high_it_starts_is_counted_from_the_terrain() -> None:
    here = load_ground(slope(0.2, 0.1))
    low, high = (
        spawn_pose(world(None, (shipped("rover"), replace(PLACE, z_m=z))).vehicles[0], here)
        for z in (0.0, 0.7)
    )
    assert high[0][2] - low[0][2] == pytest.approx(0.7)
    assert high[1] == low[1]


@pytest.mark.parametrize(
    ("place", "problem"),
    [
        (Placement(x_m=40.5), r"vehicles\[0\].placement`: `it` starts outside the terrain; "
                              "expected x_m from -40 to 40 m and y_m from -40 to 40 m"),
        (Placement(z_m=-0.1), r"placement.z_m`: `it` starts in the terrain"),
        (Placement(x_m=10.0), r"`it` starts inside `hut`"),
    ],
)  # fmt: skip
def test_a_place_where_nothing_can_stand_is_refused(place: Placement, problem: str) -> None:
    hut = Solid("hut", Box(size_m=(4.0, 4.0, 3.0)), "ground", (10.0, 0.0, 5.0 + 0.2 * 10 + 1.5))
    scenario = world(slope(0.2, 0.0), (shipped("rover"), place))
    scenario = replace(scenario, world=replace(scenario.world, solids=(hut,)))
    with pytest.raises(WorldError, match=problem):
        check_spawns(scenario, solids(scenario))


@pytest.mark.parametrize(("z_m", "stands"), [(0.0, True), (0.5, True), (-0.01, False)])
def test_only_what_is_not_higher_than_a_place_can_carry_something_there(
    z_m: float, stands: bool
) -> None:
    plate = Solid("plate", Box(size_m=(2.0, 2.0, 0.5)), "plaster", (0.0, 0.0, 0.25))
    assert (floor_problem(0.5, 0.5, z_m, [plate]) == "") is stands
    assert "nothing is below it" in floor_problem(1.5, 0.5, z_m, [plate])


@pytest.mark.parametrize("side", [-1, 1])
def test_where_a_wheel_is_beside_the_map_the_ground_is_as_high_as_its_edge(side: int) -> None:
    flat = load_ground(terrain(np.full((41, 41), 2.0)))
    edge = flat.x0_m + (flat.cell_m * 40 if side > 0 else 0.0)
    vehicle = world(None, (shipped("rover"), Placement(x_m=edge))).vehicles[0]
    origin, _ = spawn_pose(vehicle, flat)
    assert origin[2] == pytest.approx(2.0 + vehicle.model.base_height_m)
