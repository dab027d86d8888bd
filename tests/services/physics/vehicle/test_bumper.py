# SPDX-License-Identifier: Apache-2.0
"""A collision lasts as long as the bumper's spring swings."""

from math import pi, sqrt

import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.core.clock import TICK_RATE_HZ, TICK_SECONDS
from groundlink.scenario.schema import Scenario, Vehicle, World
from groundlink.scenario.vehicle import Bumper
from services.physics.simulation.simulation import Simulation
from services.physics.trials.track import FLOOR, MATERIALS, NAME, drive
from tests.services.physics.grounds import shipped, wall

SPEED_MPS = 1.0


def crash(stiffness_npm: float | None) -> tuple[float, float, float]:
    """Return duration (s), largest deceleration (m/s2) and speed afterwards of a rolling rover."""
    model = shipped("rover")
    model = replace(
        model,
        drive=replace(model.drive, max_wheel_torque_nm=0.01),
        bumper=Bumper(stiffness_npm=stiffness_npm) if stiffness_npm else None,
    )
    vehicle = Vehicle(name=NAME, model=model, effects=("bumper",) if stiffness_npm else ())
    world = World(name="wall", materials=MATERIALS)
    scenario = Scenario(name="crash", world=world, vehicles=(vehicle,))
    with Simulation(scenario, (FLOOR, wall(0.7))) as rolling:
        rolling.place(NAME, None, ((SPEED_MPS, 0.0, 0.0), (0.0, 0.0, 0.0)))
        ahead = drive(rolling, 0.6).velocity[:, 0]
    slowing = -np.diff(ahead) / TICK_SECONDS
    pulse = np.flatnonzero(slowing > slowing.max() / 20)
    return (
        (pulse[-1] - pulse[0] + 1) / TICK_RATE_HZ,
        float(slowing.max()),
        float(ahead[pulse[-1] + 1 :].min()),
    )


@pytest.mark.parametrize("stiffness_npm", [30e3, 120e3])
def test_a_collision_is_half_a_swing_of_the_bumper(stiffness_npm: float) -> None:
    model = shipped("rover")
    mass = model.chassis.mass_kg + sum(wheel.mass_kg for wheel in model.wheels)
    duration, peak, after = crash(stiffness_npm)
    # The ends of a half-sine below 1/20 of its peak are 3 % of it.
    assert duration == pytest.approx(0.97 * pi * sqrt(mass / stiffness_npm), rel=0.1)
    assert peak == pytest.approx(SPEED_MPS * sqrt(stiffness_npm / mass), rel=0.15)
    assert -SPEED_MPS < after < -0.5 * SPEED_MPS


def test_without_a_bumper_it_ends_in_a_few_ticks() -> None:
    duration, peak, _ = crash(None)
    assert duration <= 8 / TICK_RATE_HZ
    assert peak > 100.0
