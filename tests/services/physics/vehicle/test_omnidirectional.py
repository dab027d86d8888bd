# SPDX-License-Identifier: Apache-2.0
"""Bases on Mecanum and omni wheels: kinematics, physics, odometry and refusals."""

from collections.abc import Iterator
from math import cos, radians, sin, sqrt

import numpy as np
import pytest
from msgspec import UNSET, msgpack
from msgspec.structs import replace

from groundlink.episode.mission_tracker import commanded_twist
from groundlink.messages.base import Command, State, WheelCommand
from groundlink.messages.navigation import Odometry
from groundlink.scenario.running_gear import Rollers, Wheel
from groundlink.scenario.schema import Scenario, Vehicle, World
from groundlink.scenario.vehicle import Chassis, VehicleModel
from services.physics.trials.maneuvers import sideways, straight, turn
from services.physics.trials.track import NAME, drive, put
from services.physics.vehicle.controller import Controller, ControllerMemory
from services.physics.vehicle.steering import steering
from services.sensors.encoders.spec import Encoders
from services.sensors.wheel_odometry.model import WheelOdometryModel
from services.sensors.wheel_odometry.spec import WheelOdometry
from tests.services.physics.grounds import shipped

WITHIN = 0.01


def kiwi() -> VehicleModel:
    """Return a base of 30 kg on three omni wheels around it."""
    base = shipped("mecanum_base")
    wheels = tuple(
        Wheel(
            name=name,
            center_m=(0.2 * cos(radians(at)), 0.2 * sin(radians(at)), 0.0),
            radius_m=0.05,
            width_m=0.03,
            mass_kg=1.0,
            friction=0.8,
            rollers=Rollers(),
            yaw_deg=at + 90.0,
        )
        for name, at in (("front_wheel", 0.0), ("left_wheel", 120.0), ("right_wheel", 240.0))
    )
    chassis = Chassis(mass_kg=27.0, size_m=(0.4, 0.4, 0.1), center_m=(0.0, 0.0, 0.05))
    return replace(
        base,
        name="kiwi",
        chassis=chassis,
        wheels=wheels,
        suspension=replace(base.suspension, stiffness_npm=10000.0, damping_nspm=400.0),
        drive=replace(base.drive, max_wheel_torque_nm=3.0, max_wheel_speed_radps=30.0),
        mounts={},
        visuals=(),
        materials={},
    )


def test_wheels_turn_as_the_textbook_says() -> None:
    """Forward left: (v_x - v_y - (a + b) w) / r, and its mirror images."""
    model = shipped("mecanum_base")
    r, lever = 0.0759, 0.319 + 0.2755
    v, left, w = 0.4, 0.3, 0.5
    expected = [
        (v - left - lever * w) / r,
        (v + left + lever * w) / r,
        (v + left - lever * w) / r,
        (v - left + lever * w) / r,
    ]
    geometry = steering(model)
    assert geometry.speeds((v, w, left)) == pytest.approx(expected)
    assert geometry.twist(expected) == pytest.approx((v, w, left))
    # All three figures shrink together where a wheel would be too slow.
    limited = geometry.within_limits((1.0, 1.0, 1.0))
    assert limited[0] == limited[1] == limited[2]
    assert max(map(abs, geometry.speeds(limited))) == pytest.approx(14.5)


@pytest.mark.parametrize("model", [shipped("mecanum_base"), kiwi()], ids=["mecanum", "omni"])
def test_trials_are_as_expected(model: VehicleModel) -> None:
    for trial in (straight(model), turn(model), sideways(model)):
        assert [figure for figure in trial.figures if not figure.good] == []


@pytest.mark.parametrize("model", [shipped("mecanum_base"), kiwi()], ids=["mecanum", "omni"])
def test_it_turns_while_it_drives_sideways(model: VehicleModel) -> None:
    with put(model) as simulation:
        drive(simulation, 1.0, (0.1, 0.4, 0.3))
        driven = drive(simulation, 1.0, (0.1, 0.4, 0.3))
    assert driven.speed == pytest.approx(sqrt(0.1**2 + 0.3**2), rel=WITHIN)
    assert driven.velocity[:, 5].mean() == pytest.approx(0.4, rel=WITHIN)


def test_a_roller_rolls_where_a_tread_would_hold() -> None:
    model = shipped("mecanum_base")
    for ratio, least, most in ((0.02, 0.2, 0.4), (1.0, 0.0, 0.05)):
        wheels = tuple(
            replace(w, rollers=Rollers(-45.0, ratio)) if i == 0 else replace(w, friction=0.0)
            for i, w in enumerate(model.wheels)
        )
        with put(replace(model, wheels=wheels)) as simulation:
            # Along the direction in which the roller of the front left wheel rolls.
            push = (0.4 / sqrt(2), 0.4 / sqrt(2), 0.0)
            simulation.place(NAME, None, (push, (0.0, 0.0, 0.0)))
            pushed = drive(simulation, 1.0)
        assert least <= pushed.last[0] <= most


def vehicle() -> Vehicle:
    wheels = Encoders(name="wheels", topic="/wheels", frame="base_link", scale_stddev=0.01)
    odom = WheelOdometry(name="odom", topic="/odom", frame="odom", encoders="wheels", rate_hz=50)
    return Vehicle(name=NAME, model=shipped("mecanum_base"), sensors=(wheels, odom))


def states() -> Iterator[State]:
    """Yield the states of a base that drives in a curve and sideways at once."""
    with put(shipped("mecanum_base")) as simulation:
        for tick in range(1, 1601):
            simulation.command(
                NAME, Command(simulation.sim_nanos, (0.2, 0.3, 0.0), (0.0, 0.0, 0.3))
            )
            simulation.step()
            state = simulation.vehicle_states()
            yield State("t", 0, 0, tick, simulation.sim_nanos, "", state)


def test_odometry_follows_it_sideways() -> None:
    it = vehicle()
    world = World(name="track")
    exact = replace(it, sensors=(replace(it.sensors[0], scale_stddev=0.0), it.sensors[1]))
    spec = it.sensors[1]
    assert isinstance(spec, WheelOdometry)
    model, unsure = (
        WheelOdometryModel(Scenario(name="t", world=world, vehicles=(one,)), one, spec)
        for one in (exact, it)
    )
    first: Odometry | None = None
    for state in states():
        for reading in model.readings(state):
            first = first or reading
            last, truth = reading, state.vehicles[NAME].poses()[0]
        for reading in unsure.readings(state):
            rough = reading
    assert first is not None
    assert last.position_m[:2] == pytest.approx(truth[:2], abs=0.01)
    assert last.orientation[2] == pytest.approx(truth[5], abs=2e-3)
    assert last.linear_mps == pytest.approx((0.2, 0.3, 0.0), abs=2e-3)
    assert last.angular_radps[2] == pytest.approx(0.3, abs=2e-3)
    # An unknown scale of 1 % of each wheel: errors within 3 of the reported sigmas.
    covariance = np.frombuffer(rough.pose_covariance).reshape(6, 6)
    apart = np.subtract(rough.position_m[:2], truth[:2])
    sigmas = np.sqrt(np.diag(covariance)[:2])
    assert np.all(np.abs(apart) < 3 * sigmas + 0.01)
    assert np.all(sigmas > 2e-3)
    assert np.all(np.linalg.eigvalsh(covariance) >= 0.0)


def test_odometry_continues_from_its_memory() -> None:
    it = vehicle()
    scenario = Scenario(name="t", world=World(name="track"), vehicles=(it,))
    spec = it.sensors[1]
    assert isinstance(spec, WheelOdometry)
    first, successor = WheelOdometryModel(scenario, it, spec), None
    for state in states():
        mine = first.readings(state)
        if successor is not None:
            assert successor.readings(state) == mine
        if state.tick == 402:
            successor = WheelOdometryModel(scenario, it, spec)
            successor.remember(first.memory())
            successor.readings(state)
        if state.tick > 500:
            break


def test_a_checkpoint_has_its_velocity() -> None:
    controller = Controller(shipped("mecanum_base"))
    controller.command(Command(0, (0.2, 0.3, 0.0), (0.0, 0.0, 0.1)))
    for tick in range(30):
        wheels = controller.wheels(tick * 2_500_000)
    packed = msgpack.encode(controller.memory())
    other = Controller(shipped("mecanum_base"))
    other.remember(msgpack.decode(packed, type=ControllerMemory))
    assert other.wheels(30 * 2_500_000) == controller.wheels(30 * 2_500_000) != wheels


def test_its_missions_count_the_speed_in_all_directions() -> None:
    model = shipped("mecanum_base")
    assert commanded_twist(model, Command(0, (0.3, 0.4, 0.0), (0.0, 0.0, 0.2))) == (0.5, 0.2)
    names = [wheel.name for wheel in model.wheels]
    speeds = steering(model).speeds((0.3, 0.2, 0.4))
    told = commanded_twist(model, WheelCommand(0, dict(zip(names, speeds, strict=True)), {}))
    assert told == pytest.approx((0.5, 0.2))


def test_wheels_that_leave_it_free_are_refused() -> None:
    model = shipped("mecanum_base")
    alike = tuple(replace(wheel, rollers=Rollers(45.0)) for wheel in model.wheels)
    with pytest.raises(ValueError, match=r"leave the base free to move.*-45 at front left"):
        replace(model, wheels=alike)
    plain = replace(model.wheels[0], rollers=UNSET)
    with pytest.raises(ValueError, match="expected either `rollers` or `caster: true`"):
        replace(model, wheels=(plain, *model.wheels[1:]))
    rover = shipped("rover")
    with pytest.raises(ValueError, match=r"has `rollers` or `yaw_deg`.*kind: omnidirectional"):
        replace(rover, wheels=(replace(rover.wheels[0], rollers=Rollers()), *rover.wheels[1:]))
