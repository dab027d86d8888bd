# SPDX-License-Identifier: Apache-2.0
"""Vehicles on soft soil sink, slip, climb and get stuck as the models of wheels and tracks say."""

from functools import cache

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace
from scipy.optimize import brentq

from groundlink.messages.ground_truth import WheelInSoil
from groundlink.scenario.running_gear import Inflation, Tracked
from groundlink.scenario.schema import Placement, Scenario, Vehicle, World
from groundlink.scenario.vehicle import VehicleModel
from groundlink.world.solids import Box, Material, Solid
from services.physics.dynamics.backend import GRAVITY_MPS2
from services.physics.dynamics.bullet import BulletBackend
from services.physics.simulation.simulation import Simulation
from services.physics.soil.track import TrackSection, track_forces, track_sinkage
from services.physics.soil.wheel import wheel_forces, wheel_sinkage
from services.physics.trials.track import FLOOR, NAME, Drive, drive, put, slope
from tests.services.physics.grounds import SOILS, shipped
from tests.services.physics.terrains import terrain, world


def on(
    soil: str, model: VehicleModel, *extra: Solid, backend: BulletBackend | None = None
) -> Simulation:
    """Return a vehicle on a floor of soil."""
    materials = {"ground": Material(friction=1.0, soil=SOILS[soil]), "road": Material(friction=1.0)}
    return put(model, *extra, materials=materials, new_backend=lambda: backend or BulletBackend())


def in_soil(simulation: Simulation) -> tuple[WheelInSoil, ...]:
    [vitals] = simulation.vitals(0)
    return vitals.soil or ()


@cache
def pull(vehicle: str, soil_name: str, slip: float) -> float:
    """Return the drawbar pull of one side over its weight, each wheel in the rut before it."""
    model, soil = shipped(vehicle), SOILS[soil_name]
    wheels = sorted(
        (w for w in model.wheels if model.stands_on(w) and w.center_m[1] > 0),
        key=lambda wheel: -wheel.center_m[0],
    )
    whole_kg = model.chassis.mass_kg + sum(wheel.mass_kg for wheel in model.wheels)
    load = np.array(whole_kg * GRAVITY_MPS2 / (2 * len(wheels)))
    s, rut, total = np.array(slip), np.array(0.0), 0.0
    for i, wheel in enumerate(wheels):
        if isinstance(model.drive, Tracked):
            assert model.vibration
            assert model.vibration.tread
            length = (wheels[0].center_m[0] - wheels[-1].center_m[0]) / (len(wheels) - 1)
            pitch = model.vibration.tread.pitch_m
            track = TrackSection(wheel.width_m, length, i * length, 2 * wheel.radius_m, pitch)
            total += float(track_forces(soil, track, load, s, rut).drawbar_n)
            rut = track_sinkage(soil, track, load, s, rut)
        else:
            size = wheel.radius_m, wheel.width_m
            fresh = wheel_sinkage(soil, *size, load, s)
            before = np.minimum(rut, fresh)
            rut = wheel_sinkage(soil, *size, load, s, before)
            total += float(wheel_forces(soil, *size, rut, s, before).drawbar_n)
    return total / float(load * len(wheels))


@pytest.mark.parametrize("soil", ["dry_sand", "lete_sand", "clayey_soil_55"])
def test_a_standing_rover_sinks_by_its_load(soil: str) -> None:
    rover = shipped("rover")
    wheel = rover.wheels[0]
    with on(soil, rover) as simulation:
        stood = drive(simulation, 2.0)
        sunk = [found.sinkage_m for found in in_soil(simulation)]
    load = np.array(55.0 * GRAVITY_MPS2 / 4)
    expected = wheel_sinkage(SOILS[soil], wheel.radius_m, wheel.width_m, load, np.array(0.0))
    assert len(sunk) == 4
    assert sunk[:2] == pytest.approx([float(expected)] * 2, rel=0.03)
    # The body comes down with its wheels, which still turn about their hubs.
    assert stood.pose[-1, 2] == pytest.approx(rover.base_height_m - np.mean(sunk), abs=5e-4)
    assert stood.wheels[-1, 0, 2] == pytest.approx(wheel.radius_m - sunk[0], abs=5e-4)
    assert np.abs(stood.velocity[-1]).max() < 1e-3


@pytest.mark.parametrize("soil", ["dry_sand", "lete_sand", "clayey_soil_55"])
def test_a_rover_drives_with_the_slip_at_which_it_pulls_nothing(soil: str) -> None:
    expected = brentq(lambda s: pull("rover", soil, s), 0.02, 0.6, xtol=1e-3)
    with on(soil, shipped("rover")) as simulation:
        driven = drive(simulation, 10.0, (0.5, 0.0))
        slips = [found.slip for found in in_soil(simulation)]
    assert slips == pytest.approx([expected] * 4, rel=0.05)
    assert driven.speed == pytest.approx(0.5 * (1 - expected), rel=0.03)


def test_wheels_behind_roll_in_the_ruts_of_those_before() -> None:
    with on("dry_sand", shipped("rover")) as simulation:
        drive(simulation, 10.0, (0.5, 0.0))
        front, _, rear, _ = (found.sinkage_m for found in in_soil(simulation))
        slip = np.array(in_soil(simulation)[0].slip)
    wheel, load = shipped("rover").wheels[0], np.array(55.0 * GRAVITY_MPS2 / 4)
    size = wheel.radius_m, wheel.width_m
    first = wheel_sinkage(SOILS["dry_sand"], *size, load, slip)
    second = wheel_sinkage(SOILS["dry_sand"], *size, load, slip, first)
    # The thrust leans the rover back on its springs.
    assert rear / front == pytest.approx(float(second / first), rel=0.05)


def uphill(soil: str, vehicle: str, degrees: float, speed: float) -> tuple[Drive, list[float]]:
    """Drive up a slope, which gravity makes of the floor; return the slips at the end, too."""
    backend = BulletBackend()
    backend.set_gravity(
        (
            -GRAVITY_MPS2 * float(np.sin(np.radians(degrees))),
            0.0,
            -GRAVITY_MPS2 * float(np.cos(np.radians(degrees))),
        )
    )
    with on(soil, shipped(vehicle), backend=backend) as simulation:
        climbed = drive(simulation, 16.0, (speed, 0.0))
        return climbed, [found.slip for found in in_soil(simulation)]


@pytest.mark.parametrize(
    ("vehicle", "soil", "speed"), [("rover", "dry_sand", 0.5), ("tank", "clayey_soil_55", 1.0)]
)
def test_a_slope_that_theory_allows_is_climbed_and_a_steeper_one_is_not(
    vehicle: str, soil: str, speed: float
) -> None:
    most = max(pull(vehicle, soil, slip) for slip in (0.05, 0.1, 0.2, 0.4, 0.6, 0.8))
    gentle, steep = (float(np.degrees(np.arctan(share * most))) for share in (0.75, 1.25))
    climbed, _ = uphill(soil, vehicle, gentle, speed)
    assert climbed.velocity[-400:, 0].mean() > 0.2 * speed
    stuck, slips = uphill(soil, vehicle, steep, speed)
    assert stuck.speed < 0.02 * speed
    assert min(slips[:4]) > 0.9


def test_slip_uphill_is_where_the_pull_is_the_weights_share() -> None:
    gradient = float(np.tan(np.radians(6.0)))
    expected = brentq(lambda s: pull("rover", "lete_sand", s) - gradient, 0.02, 0.9, xtol=1e-3)
    _, slips = uphill("lete_sand", "rover", 6.0, 0.5)
    assert np.mean(slips) == pytest.approx(expected, rel=0.05)


def test_snow_holds_a_rover_on_its_belly() -> None:
    rover = shipped("rover")
    with on("snow", rover) as simulation:
        held = drive(simulation, 4.0, (0.5, 0.0))
        assert min(found.slip for found in in_soil(simulation)) > 0.95
    belly_m = rover.chassis.center_m[2] - rover.chassis.size_m[2] / 2
    assert held.pose[-1, 2] + belly_m == pytest.approx(0.0, abs=2e-3)
    assert held.speed < 1e-3
    assert held.pose[-1, 0] < 0.1


def test_a_rover_turns_less_than_on_a_floor_and_digs() -> None:
    with on("lete_sand", shipped("rover")) as simulation:
        drive(simulation, 2.0)
        before = max(found.sinkage_m for found in in_soil(simulation))
        turned = drive(simulation, 4.0, (0.0, 0.6))
        after = min(found.sinkage_m for found in in_soil(simulation))
    assert 0.3 < turned.velocity[-1, 5] < 0.57
    assert after > 1.5 * before
    assert np.hypot(*turned.pose[-1, :2]) < 0.1


def test_a_rover_stands_on_a_slope_of_soil() -> None:
    with on("lete_sand", shipped("rover"), *slope(2.0, degrees=10.0)) as simulation:
        drive(simulation, 20.0, (0.5, 0.0))
        drive(simulation, 3.0)
        held = drive(simulation, 5.0)
    assert held.pose[-1, 2] > 0.5
    assert np.linalg.norm(held.pose[-1, :3] - held.pose[0, :3]) < 2e-3


def test_soil_of_terrain_is_where_the_map_has_it() -> None:
    """Mud west of x = 0, firm ground east of it; the rover drives from one to the other."""
    surface = np.zeros((40, 40), np.uint8)
    surface[:, 20:] = 1
    ground = terrain(np.zeros((41, 41)), surface=surface, materials=("mud", "ground"))
    materials = {"mud": Material(friction=1.0, soil=SOILS["dry_sand"])}
    described = world(ground, (shipped("rover"), Placement(x_m=-2.0)), materials=materials)
    with Simulation(described, ()) as simulation:
        drive(simulation, 1.0)
        assert all(found.sinkage_m > 0.02 for found in in_soil(simulation))
        assert len(in_soil(simulation)) == 4
        driven = drive(simulation, 9.0, (0.5, 0.0))
        assert driven.pose[-1, 0] > 1.0
        assert in_soil(simulation) == ()


def road(x_m: float) -> Solid:
    """Return a strip of firm ground, level with the soil, from `x_m` on."""
    return Solid("road", Box(size_m=(20.0, 8.0, 0.002)), "road", (x_m + 10.0, 0.0, 0.0))


def test_wheels_rise_out_of_soil_onto_a_road() -> None:
    with on("dry_sand", shipped("rover"), road(2.0)) as simulation:
        over = drive(simulation, 12.0, (0.5, 0.0))
        assert in_soil(simulation) == ()
    rover = shipped("rover")
    assert over.pose[-1, 2] == pytest.approx(rover.base_height_m, abs=3e-3)
    assert over.speed == pytest.approx(0.5, rel=0.01)
    assert np.abs(over.velocity[400:, 2]).max() < 0.3


@pytest.mark.parametrize("vehicle", ["rover", "car"])
def test_firm_ground_is_the_same_to_the_bit_in_a_world_with_soil(vehicle: str) -> None:
    soil, plain = Material(friction=1.0, soil=SOILS["dry_sand"]), Material(friction=1.0)
    runs = []
    for other in (plain, soil):
        materials = {"ground": plain, "other": other}
        with put(shipped(vehicle), materials=materials) as simulation:
            runs.append(drive(simulation, 3.0, (1.0, 0.4)))
    assert runs[0].pose.tobytes() == runs[1].pose.tobytes()
    assert runs[0].angles.tobytes() == runs[1].angles.tobytes()


def test_the_same_run_has_the_same_bytes_also_from_its_memory() -> None:
    def states(simulation: Simulation) -> bytes:
        return drive(simulation, 0.5, (0.5, 0.3)).pose.tobytes()

    with on("dry_sand", shipped("rover")) as one, on("dry_sand", shipped("rover")) as other:
        assert states(one) == states(other)
        memory = one.memory()
        coded = msgspec.msgpack.decode(msgspec.msgpack.encode(memory), type=type(memory))
    found = []
    for _ in range(2):
        materials = {"ground": Material(friction=1.0, soil=SOILS["dry_sand"])}
        with put(shipped("rover"), materials=materials, memory=coded) as continued:
            depths = [wheel.sinkage_m for wheel in in_soil(continued)]
            found.append((depths, states(continued)))
    assert min(found[0][0]) > 0.02
    assert found[0] == found[1]


def test_links_of_unknown_pitch_are_a_sixth_of_the_road_wheels() -> None:
    """A tank without `vibration` drives, too."""
    tank = replace(shipped("tank"), vibration=None)
    with on("lete_sand", tank) as simulation:
        driven = drive(simulation, 4.0, (1.0, 0.0))
        assert 0.01 < in_soil(simulation)[0].sinkage_m < 0.03
    assert driven.speed == pytest.approx(1.0, rel=0.02)


def test_ground_without_soil_has_no_wheels_in_soil() -> None:
    with put(shipped("rover")) as simulation:
        drive(simulation, 0.1)
        [vitals] = simulation.vitals(0)
    assert vitals.soil is msgspec.UNSET


def test_less_pressure_in_its_tires_carries_a_rover_over_sand() -> None:
    rover = shipped("rover")
    inflated = tuple(
        replace(w, inflation=Inflation(pressure_pa=90e3, carcass_pa=3e3)) for w in rover.wheels
    )
    model = replace(rover, wheels=inflated)
    sand = World(name="track", materials={"ground": Material(friction=1, soil=SOILS["dry_sand"])})
    vehicles = {
        "rigid": Vehicle(name=NAME, model=rover),
        "soft": Vehicle(name=NAME, model=model, tire_pressure_pa=8e3),
    }
    sunk = {}
    for name, vehicle in vehicles.items():
        scenario = Scenario(name="track", world=sand, vehicles=(vehicle,))
        with Simulation(scenario, (FLOOR,)) as simulation:
            drive(simulation, 6.0, (0.5, 0.0))
            found = in_soil(simulation)[0]
            sunk[name] = found.sinkage_m, found.slip
    modulus = SOILS["dry_sand"].k_c / rover.wheels[0].width_m + SOILS["dry_sand"].k_phi
    flat = (11e3 / modulus) ** (1 / SOILS["dry_sand"].n)
    assert flat < sunk["soft"][0] < 1.3 * flat  # Slip digs.
    assert sunk["soft"][1] < 0.7 * sunk["rigid"][1]


def test_pressures_without_inflated_tires_are_refused() -> None:
    with pytest.raises(ValueError, match="no wheel of `rover` has an `inflation`"):
        Vehicle(name=NAME, model=shipped("rover"), tire_pressure_pa=8e4)
    tank = shipped("tank")
    air = Inflation(pressure_pa=1e5)
    wheels = (replace(tank.wheels[0], inflation=air), *tank.wheels[1:])
    with pytest.raises(ValueError, match="`tracked` drive has no `inflation`"):
        replace(tank, wheels=wheels)
