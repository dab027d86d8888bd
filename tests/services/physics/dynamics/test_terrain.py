# SPDX-License-Identifier: Apache-2.0
"""Physics on terrain: the triangles of the sensors, under every vehicle, wherever it goes."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray

from groundlink.core.clock import TICK_SECONDS
from groundlink.core.errors import UserError
from groundlink.messages.base import Command, State, encode, floats
from groundlink.scenario.schema import Placement
from groundlink.scene.spawn_pose import spawn_pose
from groundlink.world.solids import Box, Material, Solid, Sphere
from groundlink.world.terrain import BODY, Ground, Terrain, load_ground
from groundlink.world.triangles import merged
from services.physics.dynamics.backend import BASE, FREE, Backend, Surface
from services.physics.dynamics.bullet import BulletBackend
from services.physics.dynamics.terrain import TerrainWindow, TerrainWindows, reach_of
from services.physics.simulation.simulation import Simulation
from services.physics.trials.track import NAME, drive
from services.sensors.rays.scene import Scene
from services.sensors.rays.terrain import Relief
from tests.services.physics.free_bodies import FreeBodies
from tests.services.physics.grounds import VEHICLES, shipped
from tests.services.physics.terrains import hills, put, terrain, world

UPHILL = 0.25


@dataclass
class Pin:
    """Stands for a vehicle where a test wants it."""

    body: int
    position_m: tuple[float, float, float] = (0.0, 0.0, 0.0)


def pinned(backend: Backend, here: Ground) -> tuple[TerrainWindows, Pin]:
    """Return a landscape and what its one window follows."""
    ball = Solid("ball", Sphere(radius_m=1.0), "ground")
    pin = Pin(backend.add_body([ball], Surface(0.5, 0.0, FREE), mass_kg=1.0))
    landscape = TerrainWindows(backend, here, {"ground": Material()})
    landscape.carry(pin, "rover", reach_of(shipped("rover")))
    return landscape, pin


def lays(monkeypatch: pytest.MonkeyPatch, simulation: Simulation) -> list[int]:
    """Return a list to which every tick is added at which a window is laid anew."""
    ticks: list[int] = []
    lay = TerrainWindow._lay

    def noted(self: TerrainWindow, x_m: float, y_m: float) -> None:
        ticks.append(simulation.tick)
        lay(self, x_m, y_m)

    monkeypatch.setattr(TerrainWindow, "_lay", noted)
    return ticks


@cache
def rolling(steepest: float = UPHILL, cell_m: float = 1.0) -> Terrain:
    return terrain(hills(301, steepest=steepest, cell_m=cell_m), cell_m)


@pytest.mark.parametrize(("cell_m", "count"), [(0.25, 200), (10.0, 300)])
def test_rays_of_physics_and_of_sensors_meet_the_same_triangles(cell_m: float, count: int) -> None:
    """At places all over a large map, the window moved to each: within 1 mm of each other."""
    random = np.random.default_rng(3)
    heights = random.normal(100, cell_m / 4, (401, 501)) + hills(501, cell_m=cell_m)[:401]
    here = load_ground(terrain(heights, cell_m, at_m=(40.0, -70.0, 5.0)))
    half = np.array([500, 400]) * cell_m / 2 - 1e-3
    places = random.uniform(-half, half, (count, 2)) + np.array([40.0, -70.0])
    # A LiDAR's ray starts near the ground, as float32 says it.
    starts = np.column_stack([places, here.height_at(*places.T) + 2.0]).astype(np.float32)
    down = np.tile(np.float32([0, 0, -1]), (count, 1))
    scene = Scene(merged([]), terrain=Relief(here, first_label=0))
    ranges = scene.cast(starts.T, down.T, np.zeros(count, np.float32), 100.0).range_m
    backend = BulletBackend()
    try:
        landscape, pin = pinned(backend, here)
        for (x, y, z), range_m in zip(starts.astype(float).tolist(), ranges.tolist(), strict=True):
            pin.position_m = x, y, z
            landscape.follow()
            hit = backend.ray((x, y, z), (x, y, z - 100))
            assert hit is not None
            met = hit[1][2]
            assert met == pytest.approx(float(here.height_at(x, y)), abs=1e-3)
            assert z - met == pytest.approx(range_m, abs=1e-3)
    finally:
        backend.close()


def test_beside_the_map_the_ground_goes_on_as_high_as_its_edge() -> None:
    here = load_ground(rolling())
    backend = BulletBackend()
    try:
        landscape, pin = pinned(backend, here)
        for x, y in (
            (160.0, 20.25),
            (500.0, 20.25),
            (-1e5, 20.25),
            (-3.25, -151.0),
            (200.0, 300.0),
        ):
            pin.position_m = x, y, 0.0
            landscape.follow()
            hit = backend.ray((x, y, 500), (x, y, -500))
            assert hit is not None
            met = hit[1][2]
            edge = np.clip([x, y], -150, 150)
            assert met == pytest.approx(float(here.height_at(*edge)), abs=1e-4)
            assert landscape.friction_at(x, y) == Material().friction
    finally:
        backend.close()


def test_a_vehicle_drives_on_beyond_the_edge() -> None:
    slope = np.linspace(0, 1, 41) * np.ones((41, 1))
    with put(terrain(slope, 0.5), shipped("rover"), at=Placement(x_m=8.0)) as simulation:
        driven = drive(simulation, 6.0, (1.0, 0.0))
    assert driven.pose[-1, 0] > 12.0
    assert driven.pose[-1, 2] == pytest.approx(1.0 + shipped("rover").base_height_m, abs=2e-3)


@pytest.mark.parametrize("name", VEHICLES)
def test_stands_as_still_on_flat_terrain_as_on_a_floor(name: str) -> None:
    with put(terrain(np.zeros((65, 65)), 0.5), shipped(name)) as simulation:
        before = simulation.vehicle_states()[NAME].poses()[0].copy()
        stood = drive(simulation, 1.0)
    assert np.abs(np.diff(stood.velocity[:, :3], axis=0)).max() / TICK_SECONDS < 0.05
    np.testing.assert_allclose(stood.pose[-1], before, atol=1e-4)


@pytest.mark.parametrize("name", VEHICLES)
def test_edges_of_level_triangles_are_not_felt(name: str) -> None:
    model = shipped(name)
    speed = min(model.top_speed_mps / 2, 2.5)
    with put(terrain(np.zeros((201, 201)), 0.5), model) as simulation:
        drive(simulation, 2.0 + speed / model.drive.max_acceleration_mps2, (speed, 0.0))
        driven = drive(simulation, 4.0, (speed, 0.0))
    upward = np.diff(driven.velocity[:, 2]) / TICK_SECONDS
    assert upward.std() < 0.02
    assert np.abs(driven.pose[:, 2] - model.base_height_m).max() < 1e-3


@pytest.mark.parametrize(
    ("name", "cell_m"), [("rover", 1.0), ("rover", 0.5), ("car", 0.5), ("tank", 1.0)]
)
def test_crosses_the_borders_of_windows_without_a_step(
    monkeypatch: pytest.MonkeyPatch, name: str, cell_m: float
) -> None:
    model = shipped(name)
    speed = min(model.top_speed_mps, 4.0)
    at = Placement(x_m=-0.3 * 300 * cell_m / 2, yaw_deg=10.0)
    with put(rolling(cell_m=cell_m), model, at=at) as simulation:
        drive(simulation, 3.0, (speed, 0.0))
        laid, first = lays(monkeypatch, simulation), simulation.tick
        driven = drive(simulation, 40.0 * cell_m / speed, (speed, 0.0))
    upward = np.diff(driven.velocity[:, 2]) / TICK_SECONDS
    after = np.array(laid) - first
    around = np.unique(np.clip(after[:, None] + np.arange(-2, 4), 0, len(upward) - 1))
    assert len(laid) >= 3
    rest = np.delete(upward, around)
    assert np.abs(upward[around] - rest.mean()).max() < 3 * rest.std()
    steps = np.diff(driven.pose[:, 2])
    assert np.abs(steps[around]).max() < np.abs(np.delete(steps, around)).max() + 1e-4


def record(name: str) -> tuple[list[bytes], list[int]]:
    """Return the states of two vehicles that go their ways, and the ticks of their windows."""
    model = shipped(name)
    places = Placement(x_m=-10.0, yaw_deg=30.0), Placement(x_m=-10.0, y_m=9.0, yaw_deg=-60.0)
    payloads = []
    with (
        pytest.MonkeyPatch.context() as patch,
        Simulation(world(rolling(cell_m=0.5), *((model, p) for p in places)), ()) as simulation,
    ):
        laid = lays(patch, simulation)
        for tick in range(1600):
            if tick % 20 == 0:
                for other in simulation.vehicle_states():
                    command = Command(simulation.sim_nanos, (12.0, 0.0, 0.0), (0.0, 0.0, 0.1))
                    simulation.command(other, command)
            simulation.step()
            states = simulation.vehicle_states()
            payloads.append(encode(State("r", 0, 0, tick, simulation.sim_nanos, "", states)))
    return payloads, laid


def test_same_calls_give_the_same_bytes_across_windows() -> None:
    first, second = record("car"), record("car")
    assert first == second
    assert len(first[1]) >= 4


def test_where_windows_overlap_each_vehicle_meets_its_own() -> None:
    model = shipped("rover")
    places = [Placement(x_m=2.0 * i) for i in range(3)]
    scenario = world(rolling(), *((model, place) for place in places))
    with Simulation(scenario, ()) as simulation:
        for _ in range(400):
            simulation.step()
        windows = [window.body for window, _ in simulation._terrain._windows]  # type: ignore[union-attr]
        assert len(set(windows)) == 3
        found = simulation._backend.contacts()
        points = found.points[: found.count]
        for own, vehicle in zip(windows, simulation._vehicles.values(), strict=True):
            contacts = [point for point in points if point.body == vehicle.body]
            assert {point.other for point in contacts} == {own}
            force = sum(point.force_n * point.normal[2] for point in contacts)
            mass = model.chassis.mass_kg + sum(wheel.mass_kg for wheel in model.wheels)
            assert force == pytest.approx(9.80665 * mass, rel=0.01)


def test_vehicles_far_apart_and_a_window_at_top_speed() -> None:
    model = shipped("tank")
    places = [Placement(x_m=x, y_m=y) for x, y in ((-120.0, -120.0), (120.0, 120.0))]
    scenario = world(rolling(), (model, places[0]), (model, replace(places[1], yaw_deg=180.0)))
    here = load_ground(rolling())
    fastest = dict.fromkeys((vehicle.name for vehicle in scenario.vehicles), 0.0)
    with Simulation(scenario, ()) as simulation:
        for tick in range(4000):
            if tick % 20 == 0:
                for name in simulation.vehicle_states():
                    command = Command(simulation.sim_nanos, (99.0, 0.0, 0.0), (0.0, 0.0, 0.0))
                    simulation.command(name, command)
            simulation.step()
            if tick % 40 == 0:
                for name, state in simulation.vehicle_states().items():
                    x, y, z = state.poses()[0, :3]
                    assert 0.0 < z - float(here.height_at(x, y)) < 1.5
                    speed = float(np.hypot(*floats(state.base_velocity)[:2]))
                    fastest[name] = max(fastest[name], speed)
    assert min(fastest.values()) > 0.7 * model.top_speed_mps


MATERIALS = {"grass": Material(friction=0.8), "mud": Material(friction=0.05)}


def striped() -> Terrain:
    """Return a slope whose northern half is of mud."""
    heights = 0.2 * np.arange(101)[None, :] * np.ones((101, 1))
    surface = np.zeros((100, 100), np.uint8)
    surface[50:] = 1
    return terrain(heights, 1.0, surface=surface, materials=("grass", "mud"))


@pytest.mark.parametrize(("y_m", "holds"), [(-10.0, True), (10.0, False)])
def test_material_under_a_wheel_sets_its_grip(y_m: float, holds: bool) -> None:
    at = Placement(y_m=y_m)
    with put(striped(), shipped("rover"), at=at, materials=MATERIALS) as simulation:
        moved = drive(simulation, 2.0).pose[:, 0]
    assert (abs(moved[-1] - moved[0]) < 0.01) == holds
    assert holds or moved[-1] < -1.0


def test_each_place_has_the_material_of_its_cell() -> None:
    """A checkerboard: off by a cell along either axis is another material."""
    surface = (np.indices((6, 8)).sum(axis=0) % 2).astype(np.uint8)
    here = load_ground(
        terrain(
            *(np.zeros((7, 9)), 0.5), surface=surface, materials=("grass", "mud"), at_m=(3, -2, 0)
        )
    )
    landscape = TerrainWindows(FreeBodies(), here, MATERIALS)
    for row, column in np.ndindex(surface.shape):
        for inside in (0.02, 0.25, 0.48):
            x_m, y_m = here.x0_m + 0.5 * column + inside, here.y0_m + 0.5 * row + inside
            expected = ("grass", "mud")[surface[row, column]]
            assert landscape.friction_at(x_m, y_m) == MATERIALS[expected].friction


def test_chassis_rubs_on_the_material_below() -> None:
    backend = FreeBodies()
    windows = TerrainWindows(backend, load_ground(striped()), MATERIALS)
    pin = Pin(0, (0.0, -1.0, 0.0))
    window = windows.carry(pin, "rover", 1.0)
    frictions = []
    for y_m in (-1.0, 1.0, -1.0):
        pin.position_m = 0.0, y_m, 0.0
        windows.follow()
        frictions.append(backend.bodies[window].surfaces[BASE].friction)
    assert frictions == [0.8, 0.05, 0.8]


def test_a_chassis_that_touches_the_ground_has_touched_the_terrain() -> None:
    heights = np.zeros((41, 41))
    heights[:, 26:28] = 0.4
    with put(terrain(heights, 0.5), shipped("rover")) as simulation:
        drive(simulation, 5.0, (1.0, 0.0))
        [vitals] = simulation.vitals(0)
    assert [contact.name for contact in vitals.contacts] == [BODY]


def test_a_map_too_fine_is_refused() -> None:
    flat = terrain(np.zeros((9, 9)), 0.02)
    with pytest.raises(UserError, match=r"`tank` is too large .* 0.02 m: .* or more"):
        put(flat, shipped("tank"))


@pytest.mark.parametrize(("above_m", "rolled"), [(0.05, True), (0.5, False)])
def test_low_steps_above_terrain_are_rolled_over(above_m: float, rolled: bool) -> None:
    """A slab on a plateau 30 m up, on which it is not the height above z = 0 that counts."""
    plateau = np.full((65, 65), 30.0)
    slab = Solid("slab", Box(size_m=(1.0, 6.0, 2.0)), "ground", (2.0, 0.0, 29.0 + above_m))
    with put(terrain(plateau, 0.5), shipped("rover"), slab) as simulation:
        driven = drive(simulation, 3.5, (0.8, 0.0))
        [vitals] = simulation.vitals(0)
    assert (not vitals.contacts) == rolled
    assert (driven.pose[-1, 0] > 1.5) == rolled
    assert (driven.pose[:, 2].max() - driven.pose[0, 2] > 0.04) == rolled


@pytest.mark.parametrize("name", VEHICLES)
def test_random_commands_on_rough_steep_cells_break_nothing(name: str) -> None:
    random = np.random.default_rng(5)
    rough = hills(201, steepest=0.8, cell_m=0.5) + random.normal(0, 0.05, (201, 201))
    here = load_ground(terrain(rough, 0.5))
    model, twist, rows = shipped(name), (0.0, 0.0), []
    with put(terrain(rough, 0.5), model) as simulation:
        for tick in range(1600):
            if tick % 160 == 0:
                speed = model.top_speed_mps * random.choice([-1.0, 1.0]) * random.uniform(0.2, 1.0)
                twist = speed, random.uniform(-1.0, 1.0)
            if tick % 20 == 0:
                stamp = simulation.sim_nanos
                simulation.command(NAME, Command(stamp, (twist[0], 0.0, 0.0), (0.0, 0.0, twist[1])))
            simulation.step()
            rows.append(simulation.vehicle_states()[NAME].poses()[:, :3].copy())
    places: NDArray[np.float64] = np.array(rows)
    assert np.isfinite(places).all()
    x, y = np.clip(places[..., 0], -50, 50), np.clip(places[..., 1], -50, 50)
    above = places[..., 2] - here.height_at(x, y)
    assert above.min() > -0.1, "sank into the ground"
    assert above.max() < 6.0, "was thrown up"


@pytest.mark.parametrize("name", VEHICLES)
@pytest.mark.parametrize("yaw_deg", [0.0, 120.0])
def test_vehicle_starts_at_its_placement(name: str, yaw_deg: float) -> None:
    place = Placement(x_m=20.3, y_m=-7.7, z_m=0.25, yaw_deg=yaw_deg)
    scenario = world(rolling(), (shipped(name), place))
    origin, turn = spawn_pose(scenario.vehicles[0], load_ground(rolling()))
    with Simulation(scenario, ()) as simulation:
        pose = simulation.vehicle_states()[NAME].poses()[0]
    np.testing.assert_allclose(pose, [*origin, *turn], atol=1e-9)
