# SPDX-License-Identifier: Apache-2.0
"""States that are made of the ground truth are those that physics told."""

from typing import Any

import numpy as np

from groundlink.core.clock import TICK_NANOS, TICK_SECONDS
from groundlink.core.frames import matrix_from_quaternion, multiply, quaternion_from_rpy
from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.messages.base import POINT, Clock, PointCloud, State, VehicleState, floats, packed
from groundlink.messages.ground_truth import Bodies
from groundlink.messages.navigation import JointState
from groundlink.scene.bodies import body_names
from services.physics.run.ground_truth import BodyTruth, VehicleTruth
from services.view.reconstructed_states import HELD, ReceivedMessage, StateReconstructor
from services.view.viewer_subscriptions import streams_of

from .scenes import EPOCH, SCENARIO, WITH_CRATE, truth

STREAMS = streams_of(SCENARIO, "run")
MODEL = SCENARIO.vehicles[0].model


def drawable(path: str, message: Any) -> ReceivedMessage:
    return ReceivedMessage(path, STREAMS[path], message)


def clock(tick: int) -> ReceivedMessage:
    return drawable("clock", Clock(EPOCH + tick * TICK_NANOS, EPOCH, tick, EPOCH))


def cloud(tick: int, last_s: float = 0.0) -> ReceivedMessage:
    points = np.zeros(1, POINT)
    points["time"] = last_s
    stamp_nanos = EPOCH + tick * TICK_NANOS
    message = PointCloud(stamp_nanos, "lidar_link", packed(points.view(np.uint8)))
    return drawable("rover/lidar", message)


def driving(tick: int) -> State:
    """Return a state of the rover on a bend, wheels turning."""
    seconds = tick * TICK_SECONDS
    poses = np.zeros((5, 7))
    heading = 0.3 * seconds
    base = np.array(quaternion_from_rpy(0.02, -0.05, heading))
    angles = np.array([3.0, 4.0, -2.0, 5.0]) * seconds
    poses[0] = (seconds, 2.0, 0.2, *base)
    for i, wheel in enumerate(MODEL.wheels):
        turned = quaternion_from_rpy(0.0, angles[i], 0.0)
        poses[1 + i, :3] = poses[0, :3] + matrix_from_quaternion(base) @ wheel.center_m
        poses[1 + i, 3:] = multiply(base, turned)
    vehicle = VehicleState(
        packed(poses), packed(np.array([1.0, 0.1, 0, 0, 0, 0.3])), packed(angles), packed(angles)
    )
    return State("run", EPOCH, EPOCH, tick, tick * TICK_NANOS, "hash", {"rover": vehicle})


def same_turn(first: np.ndarray[Any, Any], second: np.ndarray[Any, Any]) -> None:
    np.testing.assert_allclose(np.abs((first * second).sum(axis=-1)), 1.0, atol=1e-9)


def test_links_are_where_they_were_also_between_the_poses_of_all_bodies() -> None:
    states, made = StateReconstructor(SCENARIO, "run"), []
    tell, bodies = VehicleTruth(SCENARIO.vehicles[0]), BodyTruth(SCENARIO, ())
    for tick in range(0, 80, 8):
        state = driving(tick)
        stamp = state.stamp_nanos
        came = [clock(tick)]
        rover = state.vehicles["rover"]
        odometry = tell.odometry(rover, stamp)
        wheels = tell.wheels(rover, packed(np.zeros(4)), stamp)
        came.append(drawable("rover/ground_truth/wheels", wheels))
        if poses := bodies.poses(state):  # at 10 Hz
            came.append(drawable("bodies", poses))
        came.append(drawable("rover/ground_truth", odometry))
        found, _ = states.follow(came)
        made += found
    assert len(made) == 10
    for tick, found in zip(range(0, 80, 8), made, strict=True):
        was, now = driving(tick).vehicles["rover"], found.vehicles["rover"]
        assert (found.sim_nanos, found.epoch_nanos, found.episode) == (
            tick * TICK_NANOS,
            EPOCH,
            EPOCH,
        )
        np.testing.assert_allclose(now.poses()[:, :3], was.poses()[:, :3], atol=1e-9)
        same_turn(now.poses()[:, 3:], was.poses()[:, 3:])
        np.testing.assert_allclose(floats(now.base_velocity), floats(was.base_velocity), atol=1e-9)


def test_without_the_poses_of_bodies_wheels_are_at_rest_on_the_vehicle() -> None:
    states, _ = StateReconstructor(SCENARIO, "run").follow(
        [clock(8), drawable("rover/ground_truth", truth(8))]
    )
    poses = states[0].vehicles["rover"].poses()
    np.testing.assert_allclose(poses[1:, :3] - poses[0, :3], [w.center_m for w in MODEL.wheels])


def test_vehicles_of_one_instant_are_in_one_state() -> None:
    scenario = load(SHIPPED / "two_rovers.yaml")
    streams = streams_of(scenario, "run")
    names = [vehicle.name for vehicle in scenario.vehicles]
    came = [ReceivedMessage("clock", streams["clock"], clock(0).message)]
    for name in names:  # as boxes are emptied: stream after stream
        path = f"{name}/ground_truth"
        came += [ReceivedMessage(path, streams[path], truth(tick)) for tick in (0, 8, 16)]
    states, _ = StateReconstructor(scenario, "run").follow(came)
    assert [(s.sim_nanos // TICK_NANOS, sorted(s.vehicles)) for s in states] == [
        (tick, sorted(names)) for tick in (0, 8, 16)
    ]


def test_a_cloud_waits_for_the_truth_of_its_end() -> None:
    states = StateReconstructor(SCENARIO, "run")
    sample = drawable("rover/ground_truth", truth(32))
    _, messages = states.follow([clock(0), cloud(0), sample])
    assert [each.path for each in messages] == ["clock", "rover/ground_truth"]
    _, messages = states.follow([drawable("rover/ground_truth", truth(40))])
    assert [each.path for each in messages] == ["rover/ground_truth", "rover/lidar"]


def test_a_cloud_waits_for_its_last_laser() -> None:
    """Which fires some microseconds after the revolution."""
    states = StateReconstructor(SCENARIO, "run")
    states.follow([clock(0), cloud(0, last_s=0.100007)])
    _, messages = states.follow([drawable("rover/ground_truth", truth(40))])
    assert [each.path for each in messages] == ["rover/ground_truth"]
    _, messages = states.follow([drawable("rover/ground_truth", truth(48))])
    assert [each.path for each in messages] == ["rover/ground_truth", "rover/lidar"]


def test_without_any_truth_no_more_than_some_wait() -> None:
    states = StateReconstructor(SCENARIO, "run")
    states.follow([clock(400 * HELD), *(cloud(40 * i) for i in range(2 * HELD))])
    far = drawable("rover/ground_truth", truth(400 * HELD))
    _, messages = states.follow([far])
    assert len(messages) == 1 + HELD


def test_actors_stay_at_their_last_published_pose() -> None:
    names = body_names(WITH_CRATE, ())
    poses = np.zeros((len(names), 7))
    poses[:, 6] = 1.0
    poses[names.index("crate"), :3] = (1.0, 2.0, 0.5)
    came = [clock(0), drawable("bodies", Bodies(EPOCH, names, packed(poses)))]
    states, _ = StateReconstructor(WITH_CRATE, "run").follow(
        [*came, drawable("rover/ground_truth", truth(0))]
    )
    assert floats(states[0].actors).tolist() == [1.0, 2.0, 0.5, 0.0, 0.0, 0.0, 1.0]


def test_another_round_of_a_replay_is_another_episode() -> None:
    states, episodes = StateReconstructor(SCENARIO, "run"), []
    for tick in (0, 8, 0, 8):
        found, _ = states.follow([clock(tick), drawable("rover/ground_truth", truth(tick))])
        episodes += [state.episode for state in found]
    assert episodes[0] == episodes[1] != episodes[2] == episodes[3]


def test_what_is_late_from_the_round_before_is_in_none() -> None:
    """Streams wait in boxes of their own, so some may come after the clock has jumped back."""
    states = StateReconstructor(SCENARIO, "run")
    states.follow([clock(4000), drawable("rover/ground_truth", truth(4000))])
    for came in ([clock(4008), clock(0)], [clock(8)]):
        late = [cloud(4000), drawable("rover/ground_truth", truth(4008))]
        assert states.follow([*late, *came]) == ([], came[-1:])


def test_wheels_of_another_vehicle_turn_nothing() -> None:
    empty = memoryview(b"")
    others = JointState(EPOCH, "", ("a",), packed(np.ones(1)), empty, empty)
    states, _ = StateReconstructor(SCENARIO, "run").follow(
        [
            clock(0),
            drawable("rover/ground_truth/wheels", others),
            drawable("rover/ground_truth", truth(0)),
        ]
    )
    assert not floats(states[0].vehicles["rover"].joint_positions).any()


def test_joints_are_where_the_truth_says_also_between_the_poses_of_bodies() -> None:
    scenario = load(SHIPPED / "outdoor_paper.yaml")
    model, streams = scenario.vehicles[0].model, streams_of(scenario, "run")
    names, empty = body_names(scenario, ()), memoryview(b"")
    poses = np.zeros((len(names), 7))
    poses[:, 6] = 1.0
    states = StateReconstructor(scenario, "run")

    def told(path: str, message: Any) -> ReceivedMessage:
        return ReceivedMessage(path, streams[path], message)

    def seen(turn: float) -> Any:
        at = packed(np.array([turn, 0.0]))
        joints = JointState(EPOCH, "", ("turret", "gun"), at, at, empty)
        came = [told("tank/ground_truth/joints", joints), told("tank/ground_truth", truth(0))]
        (state,), _ = states.follow(came)
        return state.vehicles["tank"].poses()[model.link_names().index("turret_link")]

    states.follow([told("clock", clock(0).message)])
    for turn in (0.0, 0.4):
        assert seen(turn)[5] == np.sin(turn / 2)
    states.follow([told("bodies", Bodies(EPOCH, names, packed(poses)))])
    assert seen(0.6)[5] == np.sin(0.3)
