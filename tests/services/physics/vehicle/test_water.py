# SPDX-License-Identifier: Apache-2.0
"""Standing water lifts and drags vehicles by the formulas, and stops motors beyond their depth."""

import numpy as np
import pytest
from msgspec import UNSET
from msgspec.structs import replace
from scipy.optimize import brentq

from groundlink.messages.ground_truth import InWater
from groundlink.scenario.schema import Scenario, Vehicle, World
from groundlink.scenario.vehicle import VehicleModel, Wading
from groundlink.world.cover import WaterArea
from services.physics.dynamics.backend import GRAVITY_MPS2
from services.physics.simulation.simulation import Simulation, SimulationMemory
from services.physics.trials.track import FLOOR, MATERIALS, NAME, drive
from tests.services.physics.grounds import shipped

WATER_KGPM3 = 1000.0
WATER_NPM3 = WATER_KGPM3 * GRAVITY_MPS2


def pool(
    model: VehicleModel, depth_m: float, *, memory: SimulationMemory | None = None
) -> Simulation:
    """Return a vehicle on a floor under water; none at a depth of 0."""
    area = WaterArea(level_m=depth_m, low_m=(-50.0, -50.0), high_m=(50.0, 50.0))
    scenario = Scenario(
        name="pool",
        world=World(name="pool", materials={**MATERIALS}, water=(area,) if depth_m else ()),
        vehicles=(Vehicle(name=NAME, model=model),),
    )
    return Simulation(scenario, (FLOOR,), memory=memory)


def wading(model: VehicleModel, **figures: float) -> VehicleModel:
    return replace(model, wading=Wading(**figures))


def in_water(simulation: Simulation) -> InWater | None:
    [vitals] = simulation.vitals(0)
    return vitals.water or None


def weight_n(model: VehicleModel) -> float:
    mass = model.chassis.mass_kg + sum(wheel.mass_kg for wheel in model.wheels)
    return mass * GRAVITY_MPS2


def displaced_m3(model: VehicleModel, level_m: float, share: float) -> float:
    """Return the volume below a level of the base, of a share of the hull's box and of tires."""
    chassis = model.chassis
    bottom = chassis.center_m[2] - chassis.size_m[2] / 2
    volume = share * float(
        np.prod(chassis.size_m[:2]) * np.clip(level_m - bottom, 0, chassis.size_m[2])
    )
    for wheel in model.wheels:
        z, dz = np.linspace(-wheel.radius_m, wheel.radius_m, 4001, retstep=True)
        chords = 2 * np.sqrt(wheel.radius_m**2 - z**2)
        below = z < level_m - wheel.center_m[2]
        volume += wheel.width_m * float(chords[below].sum() * dz)
    return volume


@pytest.mark.parametrize("share", [1.0, 0.35])
def test_a_body_floats_where_it_displaces_its_weight(share: float) -> None:
    rover = replace(shipped("rover"), wading=UNSET)
    if share < 1.0:
        rover = wading(rover, displaced_m3=share * float(np.prod(rover.chassis.size_m)))
    with pool(rover, 2.0) as simulation:
        floating = drive(simulation, 12.0)
        depth = in_water(simulation)
    carried = weight_n(rover) / WATER_NPM3
    expected = brentq(lambda z: displaced_m3(rover, 2.0 - z, share) - carried, 1.7, 2.3)
    # Its wheels hang on the springs, a little deeper than here.
    assert floating.last[2] == pytest.approx(expected, abs=0.01)
    assert abs(floating.velocity[-1, 2]) < 0.05
    assert depth is not None
    assert depth.depth_m == pytest.approx(2.0 - expected + rover.wheels[0].radius_m, abs=0.03)


def test_a_body_that_fills_with_water_stands_on_the_ground() -> None:
    rover = wading(shipped("rover"), displaced_m3=0.0)
    with pool(rover, 0.3) as simulation, pool(rover, 0.0) as dry:
        assert drive(simulation, 2.0).last[2] < drive(dry, 2.0).last[2] + 0.02


@pytest.mark.parametrize("depth_m", [0.05, 0.12])
def test_wheels_are_dragged_by_the_water_that_they_displace(depth_m: float) -> None:
    """Coasting at a speed, the vehicle in shallow water loses more by the drag of its wheels."""
    car = shipped("car")
    slowed = []
    for level in (depth_m, 0.0):
        with pool(car, level) as simulation:
            drive(simulation, 1.0)
            pose, _ = simulation.motions()[NAME]
            simulation.place(NAME, pose, ((8.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
            drive(simulation, 0.1)
            before = simulation.motions()[NAME][1][0][0]
            drive(simulation, 0.1)
            after = simulation.motions()[NAME][1][0][0]
        slowed.append(((before - after) / 0.1, (before + after) / 2))
    in_it, dry = slowed
    speed = in_it[1]
    wheels = [w for w in car.wheels if w.center_m[0] > 0]  # the others roll in their tracks
    sunk = depth_m
    drag = sum(WATER_KGPM3 / 2 * 0.75 * w.width_m * sunk * speed**2 for w in wheels)
    # The speed of the wheels comes down, too: the whole has the inertia of four wheels more.
    rolling = sum(w.axle_inertia_kgm2 / w.radius_m**2 for w in car.wheels)
    expected = drag / (weight_n(car) / GRAVITY_MPS2 + rolling)
    assert in_it[0] - dry[0] == pytest.approx(expected, rel=0.1)


def test_motors_stop_beyond_the_wading_depth_and_stay_stopped() -> None:
    rover = wading(shipped("rover"), depth_m=0.1, displaced_m3=0.0)
    with pool(rover, 0.09) as simulation:
        assert drive(simulation, 2.0, (0.5, 0.0)).last[0] > 0.4
        assert in_water(simulation) == InWater(pytest.approx(0.09, abs=0.01), False)
    with pool(rover, 0.13) as simulation:
        assert abs(drive(simulation, 2.0, (0.5, 0.0)).last[0]) < 0.05
        assert in_water(simulation) == InWater(pytest.approx(0.13, abs=0.01), True)
        memory = simulation.memory()
    with pool(rover, 0.05, memory=memory) as simulation:
        drive(simulation, 0.5, (0.5, 0.0))
        found = in_water(simulation)
        assert found
        assert found.drowned


def test_a_dry_vehicle_reports_no_water_and_moves_to_the_bit_as_without_any() -> None:
    rover = shipped("rover")
    with pool(rover, -1.0) as simulation, pool(rover, 0.0) as dry:
        assert np.array_equal(
            drive(simulation, 1.0, (0.5, 0.3)).pose, drive(dry, 1.0, (0.5, 0.3)).pose
        )
        assert in_water(simulation) is None


def test_a_run_in_water_continues_from_its_memory() -> None:
    rover = shipped("rover")
    with pool(rover, 0.2) as simulation:
        drive(simulation, 1.0, (0.5, 0.2))
        memory = simulation.memory()
    ends = []
    for _ in range(2):
        with pool(rover, 0.2, memory=memory) as simulation:
            ends.append(drive(simulation, 0.5, (0.5, 0.2)).pose)
    assert np.array_equal(*ends)
