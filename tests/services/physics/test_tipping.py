# SPDX-License-Identifier: Apache-2.0
"""Vehicles tip across a slope where the statics of their springs says."""

from functools import cache
from math import atan2, cos, degrees, radians, sin

import pytest
from msgspec.structs import replace

from groundlink.scenario.vehicle import VehicleModel
from services.physics.dynamics.backend import GRAVITY_MPS2
from services.physics.simulation.simulation import Simulation
from services.physics.trials.track import NAME, put

from .grounds import VEHICLES, shipped
from .tipping import rigid_deg, tipping_deg

TIPPED_DEG = 25.0
"""Of lean: farther than springs give way."""


@cache
def sprung_deg(name: str) -> float:
    """Return at which slope a shipped vehicle tips by statics, whose wheels do not slide."""
    return tipping_deg(shipped(name))


def gripping(name: str) -> VehicleModel:
    """Return a shipped vehicle that does not slide before it tips."""
    model = shipped(name)
    strong = replace(model.drive, max_wheel_torque_nm=10 * model.drive.max_wheel_torque_nm)
    wheels = tuple(replace(wheel, friction=3.0) for wheel in model.wheels)
    return replace(model, wheels=wheels, drive=strong)


def lean_deg(simulation: Simulation) -> float:
    """Return the roll of the base on the floor."""
    x, y, z, w = simulation.vehicle_states()[NAME].poses()[0][3:]
    return degrees(atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)))


def tilted_until_it_tips(model: VehicleModel, near_deg: float) -> float:
    """Return at which tilt of gravity, raised slowly near an angle, a vehicle falls over."""
    tilt = 0.0
    with put(model) as simulation:
        while lean_deg(simulation) < TIPPED_DEG:
            tilt += (12.0 if tilt < near_deg - 5.0 else 1.0) / 400
            down = GRAVITY_MPS2 * cos(radians(tilt))
            simulation._backend.set_gravity(  # type: ignore[attr-defined]
                (0.0, -GRAVITY_MPS2 * sin(radians(tilt)), -down)
            )
            simulation.step()
    return tilt


@pytest.mark.parametrize("name", VEHICLES)
def test_it_tips_where_its_springs_say(name: str) -> None:
    expected = sprung_deg(name)
    assert tilted_until_it_tips(gripping(name), expected) == pytest.approx(expected, abs=2.5)


@pytest.mark.parametrize(
    ("name", "rigid", "sprung"),
    [("decontamination_robot", 36.6, 29.7), ("rover", 49.7, 51.2), ("car", 54.6, 52.4)],
)
def test_the_sums_that_the_docs_have(name: str, rigid: float, sprung: float) -> None:
    assert rigid_deg(shipped(name)) == pytest.approx(rigid, abs=0.1)
    assert sprung_deg(name) == pytest.approx(sprung, abs=0.2)


def test_decontamination_robot_matches_manual_calculation() -> None:
    """At the limit all weight is on the lower wheel, at its stop, and the casters just touch."""
    travel, half_track, radius = 0.04, 0.27, 0.10
    weight = GRAVITY_MPS2 * (130.0 + 6.8 + 3.2)
    released = weight / 4 / 15000.0
    lean = (travel + released) / half_track
    above_hub = 130.0 * 0.285 / 140.0 - travel
    across = half_track * cos(lean) - above_hub * sin(lean)
    up = half_track * sin(lean) + above_hub * cos(lean) + radius
    tips_deg = sprung_deg("decontamination_robot")
    assert degrees(atan2(across, up)) == pytest.approx(tips_deg, abs=1.0)
