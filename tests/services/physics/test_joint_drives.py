# SPDX-License-Identifier: Apache-2.0
"""Every shipped vehicle driven by its joints: as by velocities, within the same limits."""

from math import atan, copysign, hypot, radians

import numpy as np
import pytest

from groundlink.core.clock import TICK_RATE_HZ
from groundlink.messages.base import Command, floats, packed
from groundlink.messages.navigation import JointState
from groundlink.ros.cdr import reader
from groundlink.ros.types import STORE, TYPES, header
from groundlink.scenario.running_gear import Ackermann, Omnidirectional, SideSteered
from groundlink.scenario.vehicle import VehicleModel
from services.physics.simulation.simulation import Simulation
from services.physics.trials.track import NAME, put

from .free_bodies import FreeBodies
from .grounds import VEHICLES, shipped

NOTHING = memoryview(b"")
NAN = float("nan")

COMMAND_TICKS = 8
"""50 commands per second, as ros2_control sends them."""

ROUTE = ((1.0, 0.8, 0.0), (1.5, 0.8, 0.15), (1.5, 0.8, -0.1), (0.5, 0.0, 0.0))
"""Seconds, m/s and rad/s: straight ahead, to the left, to the right, stop."""


def command(
    stamp_nanos: int,
    names: tuple[str, ...],
    *,
    position: tuple[float, ...] = (),
    velocity: tuple[float, ...] = (),
    effort: tuple[float, ...] = (),
) -> JointState:
    arrays = (packed(np.array(values)) for values in (position, velocity, effort))
    return JointState(stamp_nanos, "", names, *arrays)


def from_ros(
    model: VehicleModel,
    names: tuple[str, ...],
    *,
    position: tuple[float, ...] = (),
    velocity: tuple[float, ...] = (),
    effort: tuple[float, ...] = (),
) -> JointState:
    """Return what the bus has of a JointState that ROS publishes."""
    arrays = (np.array(values, np.float64) for values in (position, velocity, effort))
    ros_type = "sensor_msgs/msg/JointState"
    body = STORE.serialize_cdr(TYPES[ros_type](header(0, ""), [*names], *arrays), ros_type)
    read = reader(JointState, ros_type, model.joint_interfaces())(body, 0)
    assert isinstance(read, JointState)
    return read


def shafts(model: VehicleModel) -> tuple[str, ...]:
    return tuple(s.name for s in model.drive.shafts(model.wheels) if s.driven)


def by_kinematics(model: VehicleModel, linear: float, angular: float) -> JointState:
    """Return the joints' command for a velocity, as a controller of ros2_control computes it.

    Velocities and positions have no gaps, as `topic_based_ros2_control` publishes them.
    """
    drive_spec = model.drive
    driven = [s for s in drive_spec.shafts(model.wheels) if s.driven]
    centers = {wheel.name: wheel.center_m for wheel in model.wheels}
    names = (*(shaft.name for shaft in driven), *drive_spec.steering_joints)
    if isinstance(drive_spec, SideSteered):
        ys = [drive_spec.track_multiplier * model.wheels[s.wheels[0]].center_m[1] for s in driven]
        speeds = [(linear - angular * y) / s.radius_m for y, s in zip(ys, driven, strict=True)]
        return from_ros(model, names, velocity=tuple(speeds))
    if isinstance(drive_spec, Omnidirectional):
        speeds = [x * linear + turn * angular for x, _, turn in drive_spec.rows(model.wheels)]
        return from_ros(model, names, velocity=tuple(speeds))
    assert isinstance(drive_spec, Ackermann)
    x_axle = min(x for x, _, _ in centers.values())
    curvature = angular / linear if linear else 0.0
    speeds = []
    for shaft in driven:
        x, y, _ = centers[shaft.name]
        along = linear - linear * curvature * y
        across = linear * curvature * (x - x_axle)
        speeds.append(copysign(hypot(along, across), along) / shaft.radius_m)
    angles = [
        atan(curvature * (x - x_axle) / (1.0 - curvature * y))
        for x, y, _ in (centers[name] for name in drive_spec.steered)
    ]
    return from_ros(model, names, velocity=tuple(speeds), position=tuple(angles))


def stamped(joints: JointState, stamp_nanos: int) -> JointState:
    return JointState(
        stamp_nanos, "", joints.names, joints.positions, joints.velocities, joints.efforts
    )


def path(simulation: Simulation, model: VehicleModel, *, by_joints: bool) -> np.ndarray:
    """Drive the route; return x, y of the base at each command."""
    rows = []
    for seconds, linear, angular in ROUTE:
        joints = by_kinematics(model, linear, angular)
        for tick in range(round(seconds * TICK_RATE_HZ)):
            if tick % COMMAND_TICKS == 0:
                now = simulation.sim_nanos
                twist = Command(now, (linear, 0.0, 0.0), (0.0, 0.0, angular))
                assert simulation.command(NAME, stamped(joints, now) if by_joints else twist)
                rows.append(simulation.vehicle_states()[NAME].poses()[0, :2].copy())
            simulation.step()
    return np.array(rows)


@pytest.mark.parametrize("name", VEHICLES)
def test_joints_drive_the_path_that_a_twist_drives(name: str) -> None:
    model = shipped(name)
    with put(model) as simulation:
        by_twist = path(simulation, model, by_joints=False)
    with put(model) as simulation:
        by_joints = path(simulation, model, by_joints=True)
    length = float(np.hypot(*np.diff(by_twist, axis=0).T).sum())
    assert length > 2.5
    assert np.hypot(*(by_joints - by_twist).T).max() < 0.01 * length


def floating(model: VehicleModel) -> Simulation:
    """Return a vehicle in the air: its wheels meet nothing, and each tick is cheap."""
    return put(model, new_backend=FreeBodies)


def speeds_after(simulation: Simulation, model: VehicleModel, ticks: int) -> dict[str, float]:
    """Step; return the speeds of the driven shafts."""
    for _ in range(ticks):
        simulation.step()
    speeds = floats(simulation.vehicle_states()[NAME].joint_velocities)
    return {
        shaft.name: float(speeds[shaft.wheels[0]])
        * model.wheels[shaft.wheels[0]].radius_m
        / shaft.radius_m
        for shaft in model.drive.shafts(model.wheels)
        if shaft.driven
    }


@pytest.mark.parametrize("name", ["car", "rover"])
def test_a_velocity_keeps_the_drives_limits_and_ends_with_its_timeout(name: str) -> None:
    model = shipped(name)
    names, limits = shafts(model), model.drive
    radius = min(shaft.radius_m for shaft in limits.shafts(model.wheels) if shaft.driven)
    seconds = model.top_speed_mps / limits.max_acceleration_mps2
    most = 1.01 * limits.max_acceleration_mps2 / radius * COMMAND_TICKS / TICK_RATE_HZ
    now = dict.fromkeys(names, 0.0)
    with floating(model) as simulation:
        for _ in range(round((seconds + 0.3) * TICK_RATE_HZ / COMMAND_TICKS)):
            asked = command(simulation.sim_nanos, names, velocity=(1e6,) * len(names))
            assert simulation.command(NAME, asked)
            before, now = now, speeds_after(simulation, model, COMMAND_TICKS)
            assert all(now[each] - before[each] <= most for each in names)
        assert max(now.values()) == pytest.approx(limits.max_wheel_speed_radps, rel=0.01)
        ticks = round((limits.command_timeout_s + seconds + 0.5) * TICK_RATE_HZ)
        stopped = speeds_after(simulation, model, ticks)
    assert list(stopped.values()) == pytest.approx([0.0] * len(names), abs=1e-6)


@pytest.mark.parametrize("name", VEHICLES)
def test_an_effort_is_the_torque_at_the_shaft_until_its_timeout(name: str) -> None:
    model = shipped(name)
    names, drive_spec = shafts(model), model.drive
    torque = 0.2 * drive_spec.max_wheel_torque_nm
    with floating(model) as simulation:
        assert simulation.command(NAME, command(0, names, effort=(torque,) * len(names)))
        latency_s = drive_spec.motor.latency_s if drive_spec.motor else 0.0
        speeds_after(simulation, model, 1 + round(latency_s * TICK_RATE_HZ))
        torques = floats(simulation.motor_torques(NAME))
        of_shaft = [
            sum(float(torques[i]) * s.radius_m / model.wheels[i].radius_m for i in s.wheels)
            for s in drive_spec.shafts(model.wheels)
            if s.driven
        ]
        assert of_shaft == pytest.approx([torque] * len(names))
        # It never turns a wheel faster than the controller allows, however long it acts.
        for _ in range(8):
            asked = command(simulation.sim_nanos, names, effort=(1e6,) * len(names))
            assert simulation.command(NAME, asked)
            fast = speeds_after(simulation, model, TICK_RATE_HZ // 4)
        assert max(fast.values()) <= drive_spec.max_wheel_speed_radps * 1.001
        ticks = round((drive_spec.command_timeout_s + 1.0) * TICK_RATE_HZ)
        stopped = speeds_after(simulation, model, ticks)
    assert max(map(abs, stopped.values())) < 1e-3 * max(fast.values())


def test_joints_that_a_command_leaves_out_keep_theirs_until_a_twist() -> None:
    """Steering and wheels come on two topics of ros2_controllers."""
    model = shipped("car")
    steering = model.drive.steering_joints
    with floating(model) as simulation:
        assert simulation.command(NAME, command(0, steering, position=(0.3, 9.0)))
        for _ in range(2):
            wheels = shafts(model)
            now = simulation.sim_nanos
            asked = command(now, wheels, velocity=(2.0, NAN), effort=(NAN, NAN))
            assert simulation.command(NAME, asked)
            speeds = speeds_after(simulation, model, 160)
        angles, turning = map(floats, simulation.steering(NAME))
        assert speeds["front_left_wheel"] == pytest.approx(2.0, rel=0.01)
        assert speeds["front_right_wheel"] == pytest.approx(0.0, abs=0.01)
        most = radians(model.drive.max_steering_deg)  # type: ignore[union-attr]
        assert angles.tolist() == pytest.approx([0.3, most], abs=1e-3)
        assert turning.tolist() == pytest.approx([0.0, 0.0], abs=1e-3)
        # Without commands wheels stop, and stay where they are steered.
        assert speeds_after(simulation, model, 400)["front_left_wheel"] == pytest.approx(0.0)
        assert floats(simulation.steering(NAME)[0]).tolist() == pytest.approx([0.3, most], abs=1e-3)
        now = simulation.sim_nanos
        assert simulation.command(NAME, Command(now, (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
        speeds_after(simulation, model, 400)
        assert floats(simulation.steering(NAME)[0]).tolist() == pytest.approx([0.0, 0.0], abs=1e-3)


def test_a_stale_command_of_wheels_does_not_act() -> None:
    model = shipped("rover")
    with floating(model) as simulation:
        speeds_after(simulation, model, 400)
        assert not simulation.command(NAME, command(0, shafts(model)[:1], velocity=(1.0,)))
        assert not any(speeds_after(simulation, model, 2).values())


@pytest.mark.parametrize(
    ("joints", "why"),
    [
        (command(0, ("front_left_wheel",), position=(1.0,)), "no joint gets a value"),
        (command(0, ("front_left_wheel",), velocity=(NAN,)), "no joint gets a value"),
        (command(0, ("front_left_wheel",), velocity=(float("inf"),)), "infinite"),
        (command(0, ("hatch",), velocity=(1.0,)), "no joint `hatch`"),
    ],
)
def test_commands_that_move_nothing_are_refused(joints: JointState, why: str) -> None:
    with floating(shipped("car")) as simulation, pytest.raises(ValueError, match=why):
        simulation.command(NAME, joints)


def test_a_name_that_the_vehicle_lacks_is_ignored() -> None:
    with floating(shipped("rover")) as simulation:
        names = (shafts(shipped("rover"))[0], "gripper")
        assert simulation.command(NAME, command(0, names, velocity=(1.0, 1.0)))
        assert speeds_after(simulation, shipped("rover"), 160)[names[0]] == pytest.approx(1.0)
