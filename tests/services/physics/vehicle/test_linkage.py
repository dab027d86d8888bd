# SPDX-License-Identifier: Apache-2.0
"""Rocker-bogie: loads of its wheels, the bar between its rockers, and steps that it climbs."""

from math import atan2, degrees
from xml.etree import ElementTree

import numpy as np
import pytest
from msgspec import UNSET
from msgspec.structs import replace

from groundlink.messages.base import floats
from groundlink.ros.robot_description import urdf as description
from groundlink.scenario.joints import Arm, Linkage
from groundlink.scenario.running_gear import Suspension
from groundlink.scenario.vehicle import VehicleModel
from groundlink.world.solids import Box, Solid
from services.physics.dynamics.backend import GRAVITY_MPS2
from services.physics.simulation.simulation import Simulation
from services.physics.trials.track import NAME, drive, put
from tests.services.physics.grounds import shipped

RADIUS_M = 0.125
STEP_M = 1.4 * RADIUS_M


def without_arms() -> VehicleModel:
    """Return a vehicle with the same wheels on springs of the body."""
    model = shipped("rocker_bogie")
    arms_kg = sum(arm.mass_kg for arm in model.arms)
    chassis = replace(model.chassis, mass_kg=model.chassis.mass_kg + arms_kg)
    return replace(model, linkage=UNSET, chassis=chassis)


def block(x_m: float, y_m: float, size_m: tuple[float, float, float]) -> Solid:
    return Solid("block", Box(size_m=size_m), "ground", (x_m, y_m, size_m[2] / 2))


def loads_n(simulation: Simulation) -> list[float]:
    wheels = simulation._vehicles[NAME].running_gear.wheels
    simulation._fleet.touch(simulation.tick)
    return [wheel.contact[3] if wheel.contact else 0.0 for wheel in wheels]


def pitch_deg(simulation: Simulation) -> float:
    _, _, _, x, y, z, w = simulation.vehicle_states()[NAME].poses()[0].tolist()
    return degrees(np.arcsin(2 * (w * y - x * z)))


def test_all_wheels_carry_alike_on_uneven_ground() -> None:
    """With the front left wheel on a block; springs of a body alone leave wheels in the air."""
    under = block(0.42, 0.35, (0.2, 0.2, 0.1))
    spread = {}
    for model in (shipped("rocker_bogie"), without_arms()):
        with put(model, under) as simulation:
            simulation.place(NAME, ((0.0, 0.0, 0.25), (0.0, 0.0, 0.0, 1.0)), None)
            drive(simulation, 3.0)
            loads = loads_n(simulation)
            angles = floats(simulation.vehicle_states()[NAME].servo_positions).tolist()
        spread[model.linkage is UNSET] = min(loads) / max(loads)
        if model.linkage:
            # The bar: rockers lean in opposite directions, each by half of what one side rises.
            left, _, right, _ = angles
            assert left == pytest.approx(-right, abs=2e-3)
            assert abs(degrees(left)) > 4.0
            weight = sum(loads) / GRAVITY_MPS2
            assert weight == pytest.approx(26 + 2 * (4 + 3) + 6 * 2.6, rel=0.01)
    assert spread[False] > 0.75
    assert spread[True] == 0.0


def test_a_bogie_s_wheels_share_the_moment_of_their_thrust() -> None:
    """The sum of moments about the pivot of a bogie while the vehicle gains speed."""
    model = shipped("rocker_bogie")
    wheel, bogie = model.wheels[2], model.arms[1]
    with put(model) as simulation:
        drive(simulation, 0.6, (1.0, 0.0))
        before = drive(simulation, 0.1, (1.0, 0.0))
        loads = loads_n(simulation)
        middle, rear = loads[2], loads[4]
    acceleration = float(np.diff(before.velocity[[0, -1], 0])[0]) / (39 * 0.0025)
    spin = wheel.axle_inertia_kgm2 * acceleration / RADIUS_M
    whole_kg = 26 + 2 * (4 + 3) + 6 * 2.6
    thrust = whole_kg * acceleration / 6
    pivot = bogie.pivot_m[2]
    moment = 2 * thrust * (pivot + RADIUS_M) - 2 * wheel.mass_kg * acceleration * pivot
    moment -= bogie.mass_kg * acceleration * (pivot - bogie.mass_center_m[2]) + 2 * spin
    assert acceleration == pytest.approx(1.0, rel=0.02)
    # Wheels stand 0.21 m from the pivot.
    assert (rear - middle) * 0.21 == pytest.approx(moment, rel=0.1)


def test_it_climbs_a_step_that_is_higher_than_its_wheels_radius() -> None:
    pitches = {}
    for model in (shipped("rocker_bogie"), without_arms()):
        with put(model, block(6.0, 0.0, (10.0, 6.0, STEP_M))) as simulation:
            steepest = 0.0
            for _ in range(80):
                drive(simulation, 0.1, (0.35, 0.0))
                steepest = max(steepest, abs(pitch_deg(simulation)))
            height = simulation.vehicle_states()[NAME].poses()[0, 2] - RADIUS_M
        pitches[model.linkage is UNSET] = steepest
        if model.linkage:
            assert height == pytest.approx(STEP_M, abs=2e-3)
    assert pitches[False] < 0.75 * pitches[True]


def test_poses_of_arms_and_wheels_fit_together() -> None:
    model = shipped("rocker_bogie")
    with put(model, block(0.42, 0.35, (0.2, 0.2, 0.1))) as simulation:
        simulation.place(NAME, ((0.0, 0.0, 0.25), (0.0, 0.0, 0.0, 1.0)), None)
        drive(simulation, 2.0)
        state = simulation.vehicle_states()[NAME]
    poses = dict(zip(model.link_names(), state.poses().tolist(), strict=True))
    between = np.subtract(poses["left_bogie_link"][:3], poses["left_rocker_link"][:3])
    assert np.linalg.norm(between) == pytest.approx(np.hypot(0.21, 0.18), abs=1e-9)
    # From the bogie's pivot to its rear wheel, turned by the angles of rocker, bogie and body.
    rear, bogie = poses["rear_left_wheel_link"], poses["left_bogie_link"]
    slope = atan2(-(rear[2] - bogie[2]), -(rear[0] - bogie[0]))
    turned = 2 * atan2(bogie[4], bogie[6])
    assert slope == pytest.approx(atan2(0.06, 0.21) - turned, abs=0.02)


def test_it_goes_on_from_a_checkpoint() -> None:
    model = shipped("rocker_bogie")
    step = block(0.9, 1.0, (0.9, 2.0, 0.08))
    with put(model, step) as simulation:
        drive(simulation, 2.0, (0.4, 0.0))
        memory = simulation.memory()
    ends = []
    for _ in range(2):
        with put(model, step, memory=memory) as simulation:
            ends.append(drive(simulation, 0.5, (0.4, 0.0)))
    assert np.array_equal(ends[0].wheels, ends[1].wheels)
    assert abs(memory.vehicles[NAME].springs[6][0]) > 0.01


def test_ros_gets_arms_as_joints_between_base_and_wheels() -> None:
    model = shipped("rocker_bogie")
    robot = ElementTree.fromstring(description(model, (), (), {}))
    parents = {
        j.attrib["name"]: j.find("parent").attrib["link"]  # type: ignore[union-attr]
        for j in robot.iter("joint")
    }
    assert parents["left_rocker"] == "base_link"
    assert parents["left_bogie"] == "left_rocker_link"
    assert parents["rear_left_wheel"] == "left_bogie_link"


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"name": "rear_left_wheel"}, "two parts are named"),
        ({"parent": "boom"}, "has the parent `boom`; expected an earlier arm"),
        ({"wheels": ("front_left_wheel",)}, "carries `front_left_wheel`; expected one of"),
        ({"wheels": ()}, "carries nothing"),
        ({"mass_kg": 0.1}, r"damper of .* expected `damping_nspm` of at most .* heavier wheel and"),
    ],
)
def test_linkages_that_cannot_be_are_refused(changes: dict[str, object], match: str) -> None:
    model = shipped("rocker_bogie")
    assert model.linkage
    arms = list(model.linkage.arms)
    arms[1] = replace(arms[1], **changes)
    with pytest.raises(ValueError, match=match):
        replace(model, linkage=replace(model.linkage, arms=tuple(arms)))


def test_a_bar_needs_two_arms_on_the_base() -> None:
    model = shipped("rocker_bogie")
    assert model.linkage
    with pytest.raises(ValueError, match="got `left_bogie`; expected two of left_rocker, right_ro"):
        replace(model, linkage=replace(model.linkage, differential=("left_bogie", "right_rocker")))
    arm = Arm(name="arm", wheels=("left_wheel_1",), pivot_m=(0, 0, 0), mass_kg=9, size_m=(1, 1, 1))
    with pytest.raises(ValueError, match="a `tracked` drive has none"):
        replace(shipped("tank"), linkage=Linkage(arms=(arm,)), suspension=Suspension())
