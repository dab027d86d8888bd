# SPDX-License-Identifier: Apache-2.0
"""Plots of vehicle dynamics: tires, motors, steering, skidding."""

from functools import cache

import numpy as np
from matplotlib.figure import Figure
from msgspec.structs import replace

from groundlink.core.clock import TICK_RATE_HZ, TICK_SECONDS
from groundlink.core.frames import Floats
from groundlink.loader import load
from groundlink.loader.document import read
from groundlink.loader.scenario_files import SHIPPED
from groundlink.loader.validation_errors import convert
from groundlink.messages.base import Command, floats
from groundlink.scenario import Scenario
from groundlink.scenario.running_gear import Battery, DriveSpec, Motor, SideSteered, SkidSteer
from groundlink.scenario.schema import Placement
from groundlink.scenario.vehicle import VehicleModel
from groundlink.world.solids import Box, Material, Solid
from services.physics.running_gear.motor import BatteryCharge, Motors
from services.physics.running_gear.tire import TREAD_DAMPING, TREAD_STIFFNESS, Tire
from services.physics.simulation.simulation import Simulation
from services.physics.vehicle.steering import AckermannSteering, SkidSteering
from services.physics.vehicle.steering import steering as steering_of

from .page_style import GRAY, SERIES, label, side_by_side

BORNE_KG = 14.0
"""Mass on a wheel of the rover."""

FLOOR = Solid("floor", Box((400.0, 400.0, 1.0)), "ground", (0.0, 0.0, -0.5))


def tire() -> Figure:
    """Force of a tire that is pulled, and its limit in all directions."""
    figure, (left, right) = side_by_side(2)
    limit_n = 0.8 * 9.81 * BORNE_KG
    stiffness = TREAD_STIFFNESS * BORNE_KG / TICK_SECONDS**2
    damping = TREAD_DAMPING * BORNE_KG / TICK_SECONDS
    ticks = np.arange(1, 161)
    for slip_mps, color in zip((0.01, 0.02, 0.05), SERIES, strict=False):
        pulled = Tire(borne_kg=BORNE_KG, axle_ratio=1.0)
        forces = []
        for _ in ticks:
            pulled.meet(slip_mps, 0.0, limit_n)
            forces.append(-pulled.settle(0.0)[0])
        way_mm = 1e3 * slip_mps * ticks * TICK_SECONDS
        left.plot(way_mm[::4], forces[::4], "o", color=color, label=f"{slip_mps:g} m/s")
        smooth_mm = np.linspace(0, 4, 200)
        law = stiffness * smooth_mm / 1e3 + damping * slip_mps
        left.plot(smooth_mm, np.minimum(limit_n, law), color=color)
    left.set_xlim(0, 4)
    label(left, "A locked wheel of the rover is pulled", "way of the hub, mm", "force, N")
    left.legend()

    around = np.linspace(0, 2 * np.pi, 49)
    for ratio, color in zip((1.0, 0.6), SERIES, strict=False):
        found = []
        for angle in around:
            sliding = Tire(borne_kg=BORNE_KG, axle_ratio=ratio)
            for _ in range(200):
                sliding.meet(float(np.cos(angle)), float(np.sin(angle)), limit_n)
                force = sliding.settle(0.0)
            found.append(force)
        forward, aside = np.array(found).T
        right.plot(limit_n * np.cos(around), ratio * limit_n * np.sin(around), color=color)
        name = f"axle_friction_ratio {ratio:g}"
        right.plot(forward, aside, "o", color=color, markersize=2.5, label=name)
    right.set_aspect("equal")
    label(right, "Force of a sliding tire", "forward, N", "to the left, N")
    right.legend(loc="center")
    return figure


def motor() -> Figure:
    """Torque, power and voltage of a motor and a battery."""
    figure, (left, middle, right) = side_by_side(3)
    fitted = Motor(stall_torque_nm=60.0, no_load_speed_radps=24.0)
    drive = SkidSteer(max_wheel_torque_nm=45.0, max_wheel_speed_radps=24.0, motor=fitted)
    motors = Motors(drive)
    speeds = np.linspace(-6, 26, 65)
    for share, color in zip((1.0, 0.75, 0.5), SERIES, strict=False):
        limits = np.array([motors.limits_nm(float(speed), share) for speed in speeds])
        left.plot(speeds, limits[:, 1], color=color, label=f"{share:.0%} of the voltage")
        left.plot(speeds, limits[:, 0], color=color)
    label(left, "Limits of torque", "speed of the shaft, rad/s", "torque, N m")
    left.set_ylim(-55, 100)
    left.legend(loc="upper right")

    turning = np.linspace(0, 24, 49)
    most = np.array([motors.limits_nm(float(speed), 1.0)[1] for speed in turning])
    drawn = [motors.power_w(float(t), float(w)) for t, w in zip(most, turning, strict=True)]
    middle.plot(turning, drawn, color=SERIES[0], label="drawn")
    middle.plot(turning, most * turning, color=SERIES[2], label="work")
    middle.plot(turning, most**2 * 24.0 / 60.0, color=SERIES[3], label="heat")
    label(middle, "Power at the limit", "speed of the shaft, rad/s", "power, W")
    middle.legend()

    powers = np.linspace(0, 1600, 81)
    for charge, color in zip((1.0, 0.5, 0.1), SERIES, strict=False):
        battery = Battery(
            capacity_ah=20.0, full_v=25.2, empty_v=20.0, resistance_ohm=0.1, charge=charge
        )
        volts = []
        for power in powers:
            supply = BatteryCharge(battery)
            supply.draw(float(power))
            volts.append(supply.voltage_v)
        right.plot(powers, volts, color=color, label=f"charge {charge:.0%}")
    label(right, "Battery, 0.1 ohm", "power, W", "voltage, V")
    right.legend()
    return figure


@cache
def _shipped(name: str) -> VehicleModel:
    return convert(read(SHIPPED / "vehicles" / f"{name}.yaml"), VehicleModel)


def steering() -> Figure:
    """Angles of a car's front wheels, and wheel speeds of a rover that turns."""
    figure, (left, right) = side_by_side(2)
    car = steering_of(_shipped("car"))
    assert isinstance(car, AckermannSteering)
    curvatures = np.linspace(-0.24, 0.24, 97)
    angles = np.degrees([car.angles((2.0, 2.0 * float(k))) for k in curvatures])
    for row, name in zip(angles.T, ("left", "right"), strict=True):
        left.plot(curvatures, row, label=f"{name} front wheel")
    label(left, "Ackermann: car", "curvature of the rear axle's path, 1/m", "angle, degrees")
    left.legend()

    rover = _shipped("rover")
    skid = steering_of(rover)
    assert isinstance(skid, SkidSteering)
    rates = np.linspace(-1.5, 1.5, 31)
    speeds = np.array([skid.speeds(skid.within_limits((0.5, float(rate)))) for rate in rates])
    radius = rover.wheels[0].radius_m
    right.plot(rates, radius * speeds[:, 0], label="left side")
    right.plot(rates, radius * speeds[:, 1], label="right side")
    label(right, "Skid steering: rover at 0.5 m/s", "commanded yaw rate, rad/s", "tread, m/s")
    right.legend()
    return figure


@cache
def _plain() -> Scenario:
    scenario = load(SHIPPED / "indoor_lab.yaml")
    materials = {"ground": Material(friction=1.0)}
    return replace(scenario, world=replace(scenario.world, materials=materials))


def _turned(model: VehicleModel, rate_radps: float, seconds: float) -> Floats:
    """Return the yaw rate at each tick of a vehicle that is told to turn on the spot."""
    vehicle = replace(_plain().vehicles[0], name="it", model=model, placement=Placement())
    rates = []
    with Simulation(replace(_plain(), vehicles=(vehicle,)), (FLOOR,)) as simulation:
        for _ in range(round(seconds * TICK_RATE_HZ)):
            turn = (0.0, 0.0, rate_radps)
            simulation.command("it", Command(simulation.sim_nanos, (0.0, 0.0, 0.0), turn))
            simulation.step()
            velocity = floats(simulation.vehicle_states()["it"].base_velocity)
            rates.append(float(velocity[5]))
    return np.array(rates)


def _geometric(drive: DriveSpec) -> DriveSpec:
    """Return a drive whose controller knows nothing of skidding."""
    assert isinstance(drive, SideSteered)
    return replace(drive, track_multiplier=1.0)


def skid() -> Figure:
    """Commanded over true yaw rate without a track multiplier, against the tires' friction."""
    figure, (left, right) = side_by_side(2)
    ratios = (1.0, 0.9, 0.75, 0.6, 0.5, 0.4)
    for name, color in zip(("rover", "tank"), SERIES, strict=False):
        shipped = _shipped(name)
        found = []
        for ratio in ratios:
            wheels = tuple(replace(w, axle_friction_ratio=ratio) for w in shipped.wheels)
            model = replace(shipped, wheels=wheels, drive=_geometric(shipped.drive))
            turned = _turned(model, 0.4, 3.0)
            found.append(0.4 / float(turned[len(turned) // 2 :].mean()))
        left.plot(ratios, found, "o-", color=color, label=name)
    label(left, "Multiplier to be set", "axle_friction_ratio", "commanded / true yaw rate")
    left.legend()

    for name, color in zip(("rover", "tank", "decontamination_robot"), SERIES, strict=False):
        turned = _turned(_shipped(name), 0.4, 2.0)
        times = np.arange(len(turned)) * TICK_SECONDS
        right.plot(times[::4], turned[::4], color=color, label=name)
    right.axhline(0.4, color=GRAY, linewidth=0.8)
    label(right, "Shipped vehicles, told 0.4 rad/s", "sim time, s", "yaw rate, rad/s")
    right.legend()
    return figure
