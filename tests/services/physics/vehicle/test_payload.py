# SPDX-License-Identifier: Apache-2.0
"""Payloads: the composite body, and what it does to stopping, tipping and sinking."""

from collections.abc import Sequence
from contextlib import closing
from math import degrees, radians, sin

import numpy as np
import pytest
from msgspec import UNSET
from msgspec.structs import replace

from groundlink.core.clock import TICK_RATE_HZ, TICK_SECONDS
from groundlink.core.frames import matrix_from_quaternion
from groundlink.scenario.schema import Scenario, Vehicle, World
from groundlink.scenario.vehicle import Chassis, Payload, Suspension, VehicleModel
from groundlink.world.solids import Material
from services.physics.dynamics.backend import GRAVITY_MPS2
from services.physics.dynamics.bodies import BodyList
from services.physics.dynamics.bullet import BulletBackend
from services.physics.simulation.simulation import Simulation
from services.physics.trials.track import FLOOR, MATERIALS, NAME, drive
from services.physics.vehicle.urdf import box_moments, suspension_joint, urdf
from services.physics.vehicle.vehicle import spring_loads
from tests.services.physics.grounds import SOILS, shipped

AT_REAR = Payload(mass_kg=20.0, at_m=(-0.15, 0.05, 0.3), size_m=(0.3, 0.2, 0.4))


def loaded(
    model: VehicleModel,
    *payload: Payload,
    backend: BulletBackend | None = None,
    ground: Material = MATERIALS["ground"],
) -> Simulation:
    vehicle = Vehicle(name=NAME, model=model, payload=payload or UNSET)
    world = World(name="track", materials={"ground": ground})
    scenario = Scenario(name="track", world=world, vehicles=(vehicle,))
    backends = iter([backend] if backend else [])
    new_backend = lambda: next(backends, None) or BulletBackend()  # noqa: E731
    return Simulation(scenario, (FLOOR,), new_backend=new_backend)


def test_composite_body_is_exact() -> None:
    """Newton and Euler about the composite's center of mass, without wheels."""
    bare = shipped("rover")
    light = tuple(replace(wheel, mass_kg=1e-9, inertia_kgm2=1e-9) for wheel in bare.wheels)
    chassis = Chassis(mass_kg=40.0, size_m=(0.8, 0.5, 0.3), center_m=(0.05, 0.0, 0.1))
    soft = Suspension(0.06, 1e-6, 1e-7)
    model = replace(bare, wheels=light, chassis=chassis, suspension=soft)
    loads = (AT_REAR, Payload(mass_kg=7.0, at_m=(0.4, -0.3, 0.6)))
    with closing(BulletBackend()) as backend:
        backend.set_gravity((0.0, 0.0, 0.0))
        names = [suspension_joint(wheel) for wheel in model.wheels]
        pose = ((0.0, 0.0, 5.0), (0.0, 0.0, 0.0, 1.0))
        body = backend.add_articulated(urdf(model, loads), {}, names, pose)
        force, torque = np.array([30.0, -20.0, 50.0]), np.array([3.0, 5.0, -4.0])
        body.force_n[:], body.torque_nm[:] = force, torque
        bodies = BodyList([body])
        backend.push(bodies)
        backend.step()
        backend.sense(bodies)
        turned = np.array(body.turn_radps) / TICK_SECONDS
        moved = np.array(body.velocity_mps) / TICK_SECONDS
    masses = np.array([chassis.mass_kg, *(load.mass_kg for load in loads)])
    places = np.array([chassis.center_m, *(load.at_m for load in loads)])
    center = masses @ places / masses.sum()
    inertia = np.zeros((3, 3))
    sizes = [chassis.size_m, *(load.size_m or (0.0, 0.0, 0.0) for load in loads)]
    for mass, place, size in zip(masses, places - center, sizes, strict=True):
        own = np.diag(box_moments(mass, size))
        inertia += own + mass * (place @ place * np.eye(3) - np.outer(place, place))
    # The force acts at the center of mass of the chassis, whose motion is sensed.
    arm = places[0] - center
    expected = np.linalg.solve(inertia, torque + np.cross(arm, force))
    assert turned == pytest.approx(expected, rel=1e-5)
    assert moved == pytest.approx(force / masses.sum() + np.cross(expected, arm), rel=1e-5)


def test_springs_carry_it_from_the_start() -> None:
    model = shipped("rover")
    with loaded(model, AT_REAR) as simulation:
        first = drive(simulation, 1.0)
    assert np.ptp(first.pose[:, 2]) < 1e-4
    stiffness = model.suspension.stiffness_npm
    sunk_m = model.base_height_m - first.last[2]
    at_base = AT_REAR.mass_kg * GRAVITY_MPS2 / (len(model.wheels) * stiffness)
    assert sunk_m == pytest.approx(at_base, rel=0.02)
    # The rear springs are pressed further than those in front.
    turn = matrix_from_quaternion(first.last[3:])
    in_base = (first.wheels[-1, :, :3] - first.last[:3]) @ turn
    more = np.subtract(spring_loads(model, (AT_REAR,)), spring_loads(model)) / stiffness
    rises = in_base[:, 2] - [wheel.center_m[2] for wheel in model.wheels]
    assert rises == pytest.approx(more, abs=3e-4)


def test_it_lengthens_the_stopping_distance() -> None:
    """Brakes of one torque stop it over a distance that grows with the mass."""
    rover = shipped("rover")
    weak = replace(rover, drive=replace(rover.drive, max_wheel_torque_nm=2.0, motor=None))
    ways = []
    for payload in ((), (Payload(mass_kg=55.0, at_m=(0.0, 0.0, 0.1)),)):
        with loaded(weak, *payload) as simulation:
            drive(simulation, 5.0, (0.6, 0.0))
            begin = drive(simulation, TICK_SECONDS, (0.0, 0.0)).last[0]
            ways.append(float(drive(simulation, 3.0, (0.0, 0.0)).last[0] - begin))
    mass_kg = rover.chassis.mass_kg + sum(wheel.mass_kg for wheel in rover.wheels)
    spin_kg = sum(w.axle_inertia_kgm2 / w.radius_m**2 for w in rover.wheels)
    assert ways[1] / ways[0] == pytest.approx(1 + 55.0 / (mass_kg + spin_kg), rel=0.03)


def leans_to_deg(model: VehicleModel, payload: Sequence[Payload]) -> float:
    """Return the slope across which a vehicle tips; its treads do not slide."""
    backend = BulletBackend()
    with loaded(model, *payload, backend=backend, ground=Material(friction=3.0)) as simulation:
        tilt = radians(20.0)
        while tilt < radians(60.0):
            tilt += radians(4.0) / TICK_RATE_HZ
            backend.set_gravity((0.0, -GRAVITY_MPS2 * sin(tilt), -GRAVITY_MPS2 * np.cos(tilt)))
            simulation.step()
            qx = simulation.vehicle_states()[NAME].poses()[0][3]
            if abs(qx) > sin(radians(2.0)):
                break
    return degrees(tilt)


def test_it_tips_earlier_with_a_load_on_top() -> None:
    rover = shipped("rover")
    stiff = replace(
        rover,
        suspension=Suspension(0.01, 200000.0, 1000.0),
        wheels=tuple(replace(w, suspension=None, mass_kg=3.0) for w in rover.wheels),
    )
    on_top = Payload(mass_kg=20.0, at_m=(0.0, 0.0, 0.6))
    assert leans_to_deg(stiff, ()) - leans_to_deg(stiff, (on_top,)) > 8.0
    mass = stiff.chassis.mass_kg + 4 * 3.0
    center = stiff.chassis.mass_kg * stiff.chassis.center_m[2] + 20.0 * 0.6
    height = center / (mass + 20.0) + stiff.base_height_m
    half_track = stiff.wheels[0].center_m[1]
    assert leans_to_deg(stiff, (on_top,)) == pytest.approx(
        degrees(np.arctan(half_track / height)), abs=3.0
    )


def test_it_sinks_deeper_in_sand() -> None:
    rover, sand = shipped("rover"), Material(friction=1.0, soil=SOILS["dry_sand"])
    depths = []
    for payload in ((), (Payload(mass_kg=40.0, at_m=(0.0, 0.0, 0.1)),)):
        with loaded(rover, *payload, ground=sand) as simulation:
            drive(simulation, 2.0, (0.3, 0.0))
            depths.append([wheel.sinkage_m for wheel in simulation.vitals(0)[0].soil or ()])
    assert min(np.divide(depths[1], depths[0])) > 1.2
