# SPDX-License-Identifier: Apache-2.0
"""The ground truth is the state as ROS messages, at its declared instants."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.core.clock import TICK_NANOS
from groundlink.loader import load
from groundlink.loader.additions import SpawnPlace, addition
from groundlink.loader.scenario_files import SHIPPED
from groundlink.messages.base import State, VehicleState, floats, packed
from groundlink.scenario import Scenario
from groundlink.scenario.ros_side import BodyPoses, GroundTruth, TrueMap
from groundlink.scenario.schema import Vehicle
from groundlink.scene.build import solids
from groundlink.scene.change import with_more
from groundlink.scene.true_map import true_map
from services.physics.run.ground_truth import BodyTruth, VehicleTruth, map_truth
from services.physics.simulation.simulation import Simulation
from tests.services.physics.conftest import run

EPOCH = 10**18
LEFT = (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))
"""Turned by 90 degrees: the base's x is the world's y."""


def vehicle(rate_hz: float) -> Vehicle:
    shipped = load(SHIPPED / "indoor_lab.yaml").vehicles[0]
    return replace(shipped, frame_prefix="a/", ground_truth=GroundTruth(rate_hz=rate_hz))


def state(tick: int, *names: str) -> State:
    """Return where vehicles are, each 1 m further up than the one before."""
    vehicles = {
        name: VehicleState(
            link_poses=packed(np.array([[1.0, 2.0, 3.0 + i, *LEFT]] * 5)),
            base_velocity=packed(np.array([0.0, 0.5, 0.25, 0.1, 0.0, 0.3])),
            joint_positions=packed(np.array([0.5, -0.5, 7.0, 8.0])),
            joint_velocities=packed(np.array([1.0, -1.0, 2.0, 3.0])),
        )
        for i, name in enumerate(names or ("rover",))
    }
    return State("run", EPOCH, EPOCH, tick, tick * TICK_NANOS, "", vehicles)


def test_velocities_are_in_the_base_and_the_pose_in_the_world() -> None:
    odometry = VehicleTruth(vehicle(50.0)).odometry(state(0).vehicles["rover"], 5)
    assert odometry.stamp_nanos == 5
    assert (odometry.frame, odometry.child_frame) == ("world", "a/base_link")
    assert (odometry.position_m, odometry.orientation) == ((1.0, 2.0, 3.0), LEFT)
    assert odometry.linear_mps == pytest.approx((0.5, 0.0, 0.25))
    assert odometry.angular_radps == pytest.approx((0.0, -0.1, 0.3))
    assert not any(bytes(odometry.pose_covariance))


def test_wheels_are_joints_with_the_torque_of_their_motors() -> None:
    torques = packed(np.array([4.0, 5.0, 6.0, 7.0]))
    wheels = VehicleTruth(vehicle(50.0)).wheels(state(0).vehicles["rover"], torques, 5)
    assert (wheels.stamp_nanos, wheels.frame) == (5, "a/base_link")
    assert wheels.names == tuple(wheel.name for wheel in vehicle(50.0).model.wheels)
    assert floats(wheels.positions).tolist() == [0.5, -0.5, 7.0, 8.0]
    assert floats(wheels.velocities).tolist() == [1.0, -1.0, 2.0, 3.0]
    assert wheels.efforts == torques


def test_torques_work_as_much_as_the_motors_do(start: Callable[..., Simulation]) -> None:
    """A rover that speeds up: torque times angle is the work that its vitals tell."""
    simulation = start()
    run(simulation, 0.5, (0.0, 0.0))
    (before,) = simulation.vitals(0)
    work = 0.0
    angles = floats(simulation.vehicle_states()["rover"].joint_positions)
    for _ in range(100):
        run(simulation, 1 / 400, (0.8, 0.0))
        turned = floats(simulation.vehicle_states()["rover"].joint_positions)
        work += float(floats(simulation.motor_torques("rover")) @ (turned - angles))
        angles = turned
    (after,) = simulation.vitals(0)
    assert work > 5.0
    told = after.motor_work_j - after.braked_j - before.motor_work_j + before.braked_j
    assert work == pytest.approx(told, rel=0.02)


@pytest.mark.parametrize("rate_hz", [50.0, 30.0, 400.0])
def test_it_comes_at_its_rate_without_drift(rate_hz: float) -> None:
    truth = VehicleTruth(vehicle(rate_hz))
    due = [truth.due(state(tick)) for tick in range(401)]
    stamps = [told[0] for told in due if told is not None]
    assert len(stamps) == rate_hz + 1
    assert stamps == [EPOCH + int(i * 10**9 // rate_hz) for i in range(len(stamps))]


def moving(tick: int, *names: str) -> State:
    """Return where vehicles are that speed up along y and turn at 0.8 rad/s."""
    seconds, angle = tick / 400, 0.8 * tick / 400
    pose = [1.0, 4.0 * seconds, 0.0, 0.0, 0.0, math.sin(angle / 2), math.cos(angle / 2)]
    vehicles = {
        name: VehicleState(
            link_poses=packed(np.array([pose] * 5)),
            base_velocity=packed(np.array([0.0, seconds, 0.0, 0.0, 0.0, 0.8])),
            joint_positions=packed(np.array([angle] * 4)),
            joint_velocities=packed(np.array([seconds] * 4)),
        )
        for name in names or ("rover",)
    }
    return State("run", EPOCH, EPOCH, tick, tick * TICK_NANOS, "", vehicles)


@pytest.mark.parametrize("rate_hz", [50.0, 30.0, 29.97, 120.0])
def test_values_are_those_of_the_stamp(rate_hz: float) -> None:
    truth = VehicleTruth(vehicle(rate_hz))
    found = [(tick, truth.due(moving(tick))) for tick in range(401)]
    due = [(tick, *told) for tick, told in found if told is not None]
    assert len(due) > rate_hz - 1
    for tick, stamp, there in due:
        seconds = (stamp - EPOCH) * 1e-9
        odometry = truth.odometry(there, stamp)
        assert odometry.position_m[1] == pytest.approx(4.0 * seconds, abs=1e-8)
        assert 2 * math.asin(odometry.orientation[2]) == pytest.approx(0.8 * seconds, abs=1e-8)
        assert np.hypot(*odometry.linear_mps[:2]) == pytest.approx(seconds, abs=1e-8)
        wheels = truth.wheels(there, packed(np.zeros(4)), stamp)
        assert floats(wheels.positions) == pytest.approx([0.8 * seconds] * 4, abs=1e-8)
        assert floats(wheels.velocities) == pytest.approx([seconds] * 4, abs=1e-8)
        if stamp == EPOCH + tick * TICK_NANOS:
            assert there == moving(tick).vehicles["rover"], "to the last bit"


def test_ground_truth_of_a_later_vehicle_starts_with_it() -> None:
    truth = VehicleTruth(vehicle(30.0), from_tick=100)
    due = [truth.due(moving(tick)) for tick in range(100, 501)]
    stamps = [told[0] - EPOCH for told in due if told is not None]
    assert stamps[0] == 8 * 10**9 // 30
    assert len(stamps) == 30


def test_bodies_are_where_they_are_at_the_stamp(lab: Scenario) -> None:
    truth = BodyTruth(replace(lab, bodies=BodyPoses(rate_hz=30.0)), solids(lab))
    told = [truth.poses(moving(tick)) for tick in range(401)]
    due = [bodies for bodies in told if bodies is not None]
    assert len(due) == 31
    for bodies in due:
        seconds = (bodies.stamp_nanos - EPOCH) * 1e-9
        poses = bodies.world_from_body()[:5]
        assert poses[:, 1] == pytest.approx([4.0 * seconds] * 5, abs=1e-8)
        assert 2 * np.arcsin(poses[:, 5]) == pytest.approx([0.8 * seconds] * 5, abs=1e-8)


def test_the_bodies_are_all_links_and_all_solids_where_they_are(lab: Scenario) -> None:
    rover = lab.vehicles[0]
    scenario = replace(
        lab, vehicles=(rover, replace(rover, name="second")), bodies=BodyPoses(rate_hz=100.0)
    )
    static = solids(lab)
    truth = BodyTruth(scenario, static)
    told = [truth.poses(state(tick, "rover", "second")) for tick in range(9)]
    first, *others = [bodies for bodies in told if bodies is not None]
    assert [bodies.stamp_nanos - EPOCH for bodies in (first, *others)] == [0, 10**7, 2 * 10**7]
    where = dict(zip(first.names, first.world_from_body().tolist(), strict=True))
    assert where["rover/base_link"] == [1.0, 2.0, 3.0, *LEFT]
    assert where["second/rear_left_wheel_link"] == [1.0, 2.0, 4.0, *LEFT]
    for solid in static:
        assert where[solid.name] == [*solid.position_m, *solid.orientation]
    assert len(where) == 10 + len(static)


def test_bodies_of_a_changed_world_are_published_at_the_same_instants(lab: Scenario) -> None:
    truth = BodyTruth(replace(lab, bodies=BodyPoses(rate_hz=100.0)), solids(lab))
    told = [truth.poses(state(tick)) for tick in range(4)]
    _, more = addition("crate", at=SpawnPlace(1.0, 0.0), name=None, taken=(), ground=None)
    changed = with_more(lab, more, (), seconds=0.0)
    truth.change(changed, solids(changed))
    where = [7.0, 8.0, 9.0, *LEFT]
    for tick in range(4, 9):
        now = replace(state(tick), actors=packed(np.array(where)))
        told.append(truth.poses(now))
    stamps = [bodies.stamp_nanos - EPOCH for bodies in told if bodies is not None]
    assert stamps == [0, 10**7, 2 * 10**7]
    assert told[8] is not None
    bodies = dict(zip(told[8].names, told[8].world_from_body().tolist(), strict=True))
    assert bodies["crate"] == where
    assert list(bodies)[5] == "crate"


def test_the_map_of_a_world_is_published_at_its_rate_and_follows_the_world(lab: Scenario) -> None:
    asked = replace(lab, true_map=TrueMap(resolution_m=0.1, frame="map", rate_hz=100.0))
    truth = map_truth(asked, solids(lab))
    told = [truth.due(state(tick)) for tick in range(9)]
    first, *others = [grid for grid in told if grid is not None]
    assert [grid.stamp_nanos - EPOCH for grid in (first, *others)] == [0, 10**7, 2 * 10**7]
    known = true_map(asked, solids(lab), resolution_m=0.1)
    assert (first.frame, first.loaded_nanos, first.resolution_m) == ("map", EPOCH, 0.1)
    assert (first.height, first.width) == known.cells.shape
    assert first.origin_position_m == (known.grid.x_m, known.grid.y_m, 0.0)
    assert bytes(first.cells) == known.cells.tobytes()
    _, more = addition("barrel", at=SpawnPlace(1.0, 0.0), name=None, taken=(), ground=None)
    changed = with_more(asked, more, (), seconds=0.0)
    truth.change(changed, solids(changed))
    later = [grid for tick in range(9, 13) if (grid := truth.due(state(tick))) is not None]
    assert [grid.stamp_nanos - EPOCH for grid in later] == [3 * 10**7]
    fresh = np.frombuffer(later[0].cells, np.int8) != np.frombuffer(first.cells, np.int8)
    assert 24 < fresh.sum() < 50  # of a barrel with a radius of 0.29 m


def test_a_scenario_that_asks_for_no_map_has_none(lab: Scenario) -> None:
    truth = map_truth(lab, solids(lab))
    truth.change(lab, solids(lab))
    assert [truth.due(state(tick)) for tick in range(9)] == [None] * 9
