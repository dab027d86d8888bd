# SPDX-License-Identifier: Apache-2.0
"""Each parameter of the dynamic model does what it says: other values of it, other motions."""

from math import degrees, exp, sqrt
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.messages.base import VehicleState, WheelCommand, floats
from groundlink.scenario.running_gear import Battery, Motor, Suspension
from groundlink.scenario.schema import Placement
from groundlink.scenario.vehicle import VehicleModel
from groundlink.world.solids import Box, Solid
from services.physics.dynamics.backend import GRAVITY_MPS2
from services.physics.simulation.simulation import Simulation
from services.physics.trials.track import FLOOR, NAME, drive, put
from services.physics.vehicle.body_drag import AIR_DENSITY_KGPM3

from .grounds import shipped

HIGH = Placement(z_m=200.0)
ICE = replace(FLOOR, material="ice")
BLOCK = Solid("block", Box(size_m=(30.0, 4.0, 1.0)), "ground", (0.0, 0.0, 0.5))
"""Chassis meet it and wheels do not: a vehicle lies on its belly there."""

ON_BLOCK = Placement(z_m=0.9)


def model(name: str = "rover", **parts: dict[str, Any]) -> VehicleModel:
    """Return a shipped model with other figures of its `chassis`, of all `wheels`, its `drive`."""
    it = shipped(name)
    wheels = tuple(replace(wheel, **parts.get("wheels", {})) for wheel in it.wheels)
    chassis = replace(it.chassis, **parts.get("chassis", {}))
    return replace(
        it, chassis=chassis, wheels=wheels, drive=replace(it.drive, **parts.get("drive", {}))
    )


def state(simulation: Simulation) -> VehicleState:
    return simulation.vehicle_states()[NAME]


def kick(
    simulation: Simulation,
    linear: tuple[float, float, float] = (0.0, 0.0, 0.0),
    angular: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> None:
    """Give the vehicle a velocity."""
    vehicle = simulation._vehicles[NAME]
    simulation._backend.set_velocity(vehicle.body, linear, angular)
    vehicle.sense()


def start_mps2(it: VehicleModel, *, floor: Solid = FLOOR) -> float:
    """Return how fast a vehicle gains speed that is asked for more than it can do."""
    with put(it, floor=[floor]) as simulation:
        drive(simulation, 0.2, (5.0, 0.0))
        driven = drive(simulation, 0.5, (5.0, 0.0))
    return float(np.ptp(driven.velocity[:, 0])) / (0.5 - 0.0025)


WEAK: dict[str, Any] = {"max_wheel_torque_nm": 2.0, "max_acceleration_mps2": 1e3}
EAGER: dict[str, Any] = {"max_acceleration_mps2": 1e3, "max_angular_acceleration_radps2": 1e3}


@pytest.mark.parametrize("chassis_kg", [44.45, 144.45])
def test_mass(chassis_kg: float) -> None:
    it = model(chassis={"mass_kg": chassis_kg}, drive=WEAK)
    wheels_kg = sum(wheel.mass_kg for wheel in it.wheels)
    # Uniform cylinders roll as if half as heavy again.
    expected = 4 * 2.0 / 0.1651 / (chassis_kg + 1.5 * wheels_kg)
    assert start_mps2(it) == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("torque", [1.0, 3.0])
def test_force_of_the_wheels_joints(torque: float) -> None:
    it = model(drive={**WEAK, "max_wheel_torque_nm": torque})
    assert start_mps2(it) == pytest.approx(4 * torque / 0.1651 / (55.0 + 5.27), rel=0.01)


@pytest.mark.parametrize("about_z", [10.0, 40.0])
def test_inertia(about_z: float) -> None:
    """A robot on smooth casters turns by its two wheels against its inertia."""
    it = model(
        "decontamination_robot",
        chassis={"inertia_kgm2": (20.0, 20.0, about_z)},
        drive={**EAGER, "max_wheel_torque_nm": 1.0, "motor": None},
    )
    wheels = tuple(replace(w, friction=0.0) if w.caster else w for w in it.wheels)
    with put(replace(it, wheels=wheels)) as simulation:
        drive(simulation, 0.2, (0.0, 5.0))
        turned = drive(simulation, 0.4, (0.0, 5.0))
    rate = np.ptp(turned.velocity[:, 5]) / (0.4 - 0.0025)
    # Both wheels push at 0.27 m; they and the casters go round with the rest, and spin up.
    around = about_z + 2 * 3.4 * 1.5 * 0.27**2 + 2 * 1.6 * 0.36**2
    assert rate == pytest.approx(2 * 1.0 / 0.1 * 0.27 / around, rel=0.03)


@pytest.mark.parametrize("friction", [0.2, 0.5])
def test_friction_of_the_chassis(friction: float) -> None:
    with put(model(chassis={"friction": friction}), BLOCK, at=ON_BLOCK) as simulation:
        drive(simulation, 1.0)
        kick(simulation, (2.0, 0.0, 0.0))
        slid = drive(simulation, 3.0)
    way = np.ptp(slid.pose[:, 0])
    assert way == pytest.approx(2.0**2 / (2 * friction * GRAVITY_MPS2), rel=0.05)


@pytest.mark.parametrize("friction", [0.5, 0.9])
def test_friction_of_the_wheels_and_the_ground(friction: float) -> None:
    it = model(wheels={"friction": friction}, drive={**EAGER, "max_wheel_speed_radps": 50.0})
    assert start_mps2(it, floor=ICE) == pytest.approx(friction * 0.1 * GRAVITY_MPS2, rel=0.05)


def test_friction_along_the_axle() -> None:
    rates = []
    for ratio in (1.0, 0.5):
        with put(model(wheels={"axle_friction_ratio": ratio})) as simulation:
            drive(simulation, 1.0, (0.0, 0.5))
            rates.append(drive(simulation, 1.0, (0.0, 0.5)).velocity[:, 5].mean())
    assert rates[0] == pytest.approx(0.5, rel=0.02)
    assert rates[1] > 1.2 * rates[0]


@pytest.mark.parametrize("restitution", [0.0, 0.5, 0.8])
def test_restitution_of_the_chassis(restitution: float) -> None:
    with put(model(chassis={"restitution": restitution}), BLOCK, at=ON_BLOCK) as simulation:
        drive(simulation, 0.0025)
        kick(simulation, (0.0, 0.0, -3.0))
        fallen = drive(simulation, 0.4)
    speeds = fallen.velocity[:, 2]
    assert speeds.max() == pytest.approx(-restitution * speeds.min(), abs=0.2)


def test_restitution_of_the_wheels() -> None:
    thrown = []
    for restitution in (0.0, 0.9):
        loose = replace(
            model(wheels={"restitution": restitution}), suspension=Suspension(damping_nspm=50.0)
        )
        with put(loose, at=Placement(z_m=0.3)) as simulation:
            drive(simulation, 0.25)
            heights = []
            for _ in range(40):
                simulation.step()
                heights.append(state(simulation).poses()[1:, 2].max())
            thrown.append(max(heights) - 0.1651)
    assert thrown[0] < 0.003
    assert thrown[1] > 2 * thrown[0] + 0.002


def test_drag() -> None:
    with put(model(chassis={"drag_area_m2": 10.0}), at=HIGH) as simulation:
        fallen = drive(simulation, 5.0)
    mass = 44.45 + 4 * 2.637
    terminal = sqrt(2 * mass * GRAVITY_MPS2 / (AIR_DENSITY_KGPM3 * 10.0))
    assert fallen.velocity[-1, 2] == pytest.approx(-terminal, rel=0.01)


def test_linear_damping() -> None:
    with put(model(chassis={"linear_damping_per_s": 2.0}), at=HIGH) as simulation:
        fallen = drive(simulation, 4.0)
    assert fallen.velocity[-1, 2] == pytest.approx(-GRAVITY_MPS2 / 2.0, rel=0.01)


def test_angular_damping() -> None:
    with put(model(chassis={"angular_damping_per_s": 1.0}), at=HIGH) as simulation:
        kick(simulation, angular=(0.0, 0.0, 2.0))
        spun = drive(simulation, 1.0)
    assert spun.velocity[-1, 5] == pytest.approx(2.0 * exp(-1.0), rel=0.03)


def test_only_declared_damping_acts() -> None:
    with put(model(), at=HIGH) as simulation:
        kick(simulation, angular=(0.0, 0.0, 2.0))
        spun = drive(simulation, 1.0)
    assert spun.velocity[-1, 5] == pytest.approx(2.0, rel=1e-3)
    assert spun.velocity[-1, 2] == pytest.approx(-GRAVITY_MPS2, rel=1e-3)


def test_rolling_resistance() -> None:
    gained = [
        start_mps2(model(wheels={"rolling_resistance": share}, drive=WEAK)) for share in (0.0, 0.05)
    ]
    # By 5 % of gravity, on a mass that its wheels make seem larger.
    assert gained[0] - gained[1] == pytest.approx(0.05 * GRAVITY_MPS2 * 55 / 60.27, rel=0.02)


def test_damping_of_the_axles_joints() -> None:
    with put(model(wheels={"axle_damping_nmsprad": 0.5}, drive=WEAK)) as simulation:
        driven = drive(simulation, 8.0, (5.0, 0.0))
    assert driven.speed == pytest.approx(2.0 / 0.5 * 0.1651, rel=0.01)


@pytest.mark.parametrize("most", [3.0, 6.0])
def test_speed_of_the_wheels_joints(most: float) -> None:
    with put(model(drive={"max_wheel_speed_radps": most})) as simulation:
        driven = drive(simulation, 2.0, (9.0, 0.0))
    assert driven.speed == pytest.approx(most * 0.1651, rel=0.01)


def spin_up(it: VehicleModel) -> float:
    """Return how fast the first shaft turns after 20 ms in the air."""
    with put(it, at=HIGH) as simulation:
        for shaft in it.drive.shafts(it.wheels)[:1]:
            simulation.command(NAME, WheelCommand(0, {shaft.name: it.drive.max_wheel_speed_radps}))
        drive(simulation, 0.02)
        return float(floats(state(simulation).joint_velocities)[0])


@pytest.mark.parametrize("inertia", [0.05, 0.2])
def test_inertia_of_the_wheels(inertia: float) -> None:
    it = model(wheels={"inertia_kgm2": inertia}, drive=WEAK)
    assert spin_up(it) == pytest.approx(2.0 * 0.02 / inertia, rel=0.01)


def test_mass_of_the_belts() -> None:
    speeds = [spin_up(model("tank", drive={"belt_mass_kg": mass})) for mass in (0.0, 5000.0)]
    assert speeds[1] < 0.5 * speeds[0]


def test_range_of_the_springs() -> None:
    lowest = []
    for travel in (0.02, 0.06):
        it = replace(model(), suspension=Suspension(travel_m=travel, damping_nspm=100.0))
        with put(it, at=Placement(z_m=0.3)) as simulation:
            lowest.append(drive(simulation, 1.0).pose[:, 2].min() - it.base_height_m)
    assert lowest[0] == pytest.approx(-0.02, abs=0.005)
    assert lowest[1] == pytest.approx(-0.06, abs=0.005)


def test_force_of_the_springs() -> None:
    pitches = []
    for stiffness in (4000.0, 16000.0):
        it = replace(model(), suspension=Suspension(stiffness_npm=stiffness))
        with put(it) as simulation:
            driven = drive(simulation, 0.4, (1.5, 0.0))
        pitches.append(degrees(2 * np.abs(driven.pose[:, 4]).max()))
    assert pitches[0] > 2.0 * pitches[1]


def test_damping_of_the_springs() -> None:
    rebounds = []
    for damping in (50.0, 1500.0):
        it = replace(model(), suspension=Suspension(damping_nspm=damping))
        with put(it, at=Placement(z_m=0.02)) as simulation:
            rebounds.append(drive(simulation, 1.0).velocity[:, 2].max())
    assert rebounds[0] > 3.0 * rebounds[1]


def steered(seconds: float, twist: tuple[float, float], **drive_fields: Any) -> tuple[float, float]:
    """Return the angle (degrees) of the car's first steered wheel and the radius of its way."""
    it = model("car", drive=drive_fields)
    with put(it) as simulation:
        drive(simulation, seconds, twist)
        angle = simulation._vehicles[NAME].running_gear.angles()[0]
        way = drive(simulation, 0.5, twist)
    rate = way.velocity[:, 5].mean()
    return degrees(angle), float(way.speed / rate) if rate else float("inf")


@pytest.mark.parametrize("most_deg", [15.0, 25.0])
def test_range_of_the_steering(most_deg: float) -> None:
    angle, radius = steered(4.0, (2.0, 5.0), max_steering_deg=most_deg)
    assert angle == pytest.approx(most_deg)
    # That of the middle of the base, half a wheelbase before the line that it turns on.
    least = model("car", drive={"max_steering_deg": most_deg}).least_radius_m
    assert radius == pytest.approx(np.hypot(least, 1.3), rel=0.05)


@pytest.mark.parametrize("speed_degps", [10.0, 30.0])
def test_speed_of_the_steering(speed_degps: float) -> None:
    angle, _ = steered(0.5, (2.0, 5.0), steering_speed_degps=speed_degps)
    assert angle == pytest.approx(0.5 * speed_degps, rel=0.02)


def test_force_of_the_steering() -> None:
    # Hardly moving, where the whole footprint has to be turned.
    weak, _ = steered(0.3, (1e-6, 1e-6), steering_torque_nm=20.0)
    strong, _ = steered(0.3, (1e-6, 1e-6), steering_torque_nm=500.0)
    assert weak < 0.1
    assert strong > 10.0


@pytest.mark.parametrize("no_load", [4.0, 8.0])
def test_motor_ends_at_its_no_load_speed(no_load: float) -> None:
    motor = Motor(stall_torque_nm=20.0, no_load_speed_radps=no_load)
    with put(model(drive={"motor": motor})) as simulation:
        driven = drive(simulation, 4.0, (5.0, 0.0))
    assert driven.speed == pytest.approx(no_load * 0.1651, rel=0.02)


def test_torque_of_the_motor() -> None:
    motor = Motor(stall_torque_nm=2.0, no_load_speed_radps=1e6)
    it = model(drive={**EAGER, "motor": motor})
    assert start_mps2(it) == pytest.approx(4 * 2.0 / 0.1651 / (55.0 + 5.27), rel=0.01)


@pytest.mark.parametrize("latency", [0.0, 0.1])
def test_latency_of_the_motor(latency: float) -> None:
    motor = Motor(stall_torque_nm=20.0, no_load_speed_radps=10.0, latency_s=latency)
    with put(model(drive={"motor": motor})) as simulation:
        driven = drive(simulation, 0.3, (1.0, 0.0))
    moving = np.flatnonzero(driven.velocity[:, 0] > 1e-3)[0] / 400
    assert moving == pytest.approx(latency, abs=0.01)


def test_the_batterys_voltage_and_charge() -> None:
    motor = Motor(stall_torque_nm=20.0, no_load_speed_radps=9.0)
    speeds = []
    for charge in (1.0, 0.2):
        battery = Battery(capacity_ah=1.0, full_v=24.0, empty_v=12.0, charge=charge)
        it = replace(model(drive={"motor": motor}), battery=battery)
        with put(it) as simulation:
            speeds.append(drive(simulation, 3.0, (5.0, 0.0)).speed)
            [vitals] = simulation.vitals(0)
        assert vitals.battery is not None
        assert 0.0 < charge - vitals.battery.charge < 0.01
        assert vitals.battery.voltage_v == pytest.approx(12.0 + 12.0 * charge, rel=0.01)
    assert speeds[1] / speeds[0] == pytest.approx((12.0 + 12.0 * 0.2) / 24.0, rel=0.02)


def test_an_empty_battery_moves_nothing() -> None:
    battery = Battery(capacity_ah=0.001, full_v=24.0, empty_v=20.0, idle_power_w=50.0)
    with put(replace(model(), battery=battery)) as simulation:
        early = drive(simulation, 0.5, (1.0, 0.0)).speed
        late = drive(simulation, 8.0, (1.0, 0.0))
        [vitals] = simulation.vitals(0)
    assert early > 0.5
    assert vitals.battery is not None
    assert vitals.battery.charge == 0.0
    assert simulation._vehicles[NAME].running_gear.wheels[0].torque_nm == 0.0
    assert late.pose[-1, 0] - late.pose[0, 0] > 0.5, "rolls on by itself"


@pytest.mark.parametrize("most", [0.5, 2.0])
def test_acceleration_of_the_controller(most: float) -> None:
    with put(model(drive={"max_acceleration_mps2": most})) as simulation:
        driven = drive(simulation, 0.5, (5.0, 0.0))
    assert driven.speed == pytest.approx(0.5 * most, rel=0.03)


def test_the_sprockets_radius() -> None:
    speeds = []
    for radius in (0.2, 0.4):
        it = model("tank", drive={"sprocket_radius_m": radius, "max_wheel_speed_radps": 5.0})
        with put(it) as simulation:
            speeds.append(drive(simulation, 4.0, (50.0, 0.0)).speed)
    assert speeds == pytest.approx([1.0, 2.0], rel=0.02)


def test_the_wheels_of_a_track_roll_and_share_its_work() -> None:
    it = model("tank", drive={"sprocket_radius_m": 0.2, "max_wheel_speed_radps": 5.0})
    with put(it) as simulation:
        drive(simulation, 0.3, (0.5, 0.0))
        running_gear = simulation._vehicles[NAME].running_gear
        power_w = sum(wheel.torque_nm * wheel.speed_radps for wheel in running_gear.wheels)
        assert running_gear.driving_w > 1.0
        assert power_w == pytest.approx(running_gear.driving_w - running_gear.braking_w, rel=0.01)
        driven = drive(simulation, 2.0, (0.5, 0.0))
    speeds = [
        one.speed_radps * wheel.radius_m
        for one, wheel in zip(running_gear.wheels, it.wheels, strict=True)
    ]
    assert speeds == pytest.approx([driven.speed] * len(it.wheels), rel=0.02)


def test_in_the_air_wheels_that_are_turned_forward_turn_the_base_back() -> None:
    with put(model(), at=HIGH) as simulation:
        driven = drive(simulation, 0.2, (1.0, 0.0))
    assert driven.velocity[-1, 4] < -0.01
