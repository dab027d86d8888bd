# SPDX-License-Identifier: Apache-2.0
"""A car on creeping tires answers to steering as the linear single-track model says."""

from math import atan, sin

import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.core.clock import TICK_RATE_HZ
from groundlink.messages.base import floats
from groundlink.scenario.schema import Scenario, Vehicle, World
from groundlink.scenario.vehicle import TireSlip, VehicleModel
from services.physics.dynamics.backend import GRAVITY_MPS2
from services.physics.simulation.simulation import Simulation
from services.physics.trials.track import FLOOR, MATERIALS, NAME, drive
from tests.services.physics.grounds import shipped

SPEED_MPS, RATE_RADPS = 12.0, 0.05


def stiffness(slip: TireSlip, load_n: float) -> float:
    return slip.cornering_stiffness_nprad * sin(2 * atan(load_n / slip.load_n))


def understeer_rad_per_mps2(model: VehicleModel) -> float:
    """Return the understeer gradient by the closed form, m_f / C_f - m_r / C_r."""
    assert model.tire_slip
    chassis, front, rear = model.chassis, model.wheels[0], model.wheels[2]
    share = (chassis.center_m[0] - rear.center_m[0]) / (front.center_m[0] - rear.center_m[0])
    masses = [chassis.mass_kg * part + 2 * front.mass_kg for part in (share, 1 - share)]
    stiffnesses = [2 * stiffness(model.tire_slip, mass * GRAVITY_MPS2 / 2) for mass in masses]
    return masses[0] / stiffnesses[0] - masses[1] / stiffnesses[1]


def steady_turn(model: VehicleModel) -> tuple[float, float, float]:
    """Return speed, yaw rate and mean steering angle of a car that coasts in a circle.

    Motors that hold the speed of each wheel would turn the car by themselves.
    """
    chassis = replace(model.chassis, drag_area_m2=0.0)
    model = replace(model, chassis=chassis, drive=replace(model.drive, max_wheel_torque_nm=0.1))
    effects = ("tire_slip",) if model.tire_slip else ()
    vehicle = Vehicle(name=NAME, model=model, effects=effects)
    world = World(name="level", materials=MATERIALS)
    with Simulation(Scenario(name="turn", world=world, vehicles=(vehicle,)), (FLOOR,)) as rolling:
        rolling.place(NAME, None, ((SPEED_MPS, 0.0, 0.0), (0.0, 0.0, 0.0)))
        drive(rolling, 3.0, (SPEED_MPS, RATE_RADPS))
        turn = drive(rolling, 1.0, (SPEED_MPS, RATE_RADPS))
        angles = floats(rolling.steering(NAME)[0])
    assert len(turn.velocity) == TICK_RATE_HZ
    speed = np.hypot(*turn.velocity[:, :2].T).mean()
    return float(speed), float(turn.velocity[:, 5].mean()), float(angles.mean())


@pytest.mark.parametrize("center_x_m", [0.5, -0.5], ids=["understeers", "oversteers"])
def test_the_understeer_gradient_is_that_of_the_closed_form(center_x_m: float) -> None:
    car = shipped("car")
    _, y, z = car.chassis.center_m
    tires = TireSlip(cornering_stiffness_nprad=30000.0, load_n=4000.0)
    chassis = replace(car.chassis, center_m=(center_x_m, y, z))
    model = replace(car, chassis=chassis, tire_slip=tires)
    speed, rate, angle = steady_turn(model)
    wheelbase = 2 * car.wheels[0].center_m[0]
    gradient = (angle - wheelbase * rate / speed) / (speed * rate)
    assert gradient == pytest.approx(understeer_rad_per_mps2(model), rel=0.05)


def test_without_slip_the_circle_is_that_of_the_wheels() -> None:
    car = replace(shipped("car"), tire_slip=None)
    speed, rate, angle = steady_turn(car)
    assert angle == pytest.approx(2 * car.wheels[0].center_m[0] * rate / speed, rel=0.01)
