# SPDX-License-Identifier: Apache-2.0
"""Reading and setting the state of an entity."""

import math
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Accel, Twist, Vector3
from simulation_interfaces.msg import EntityCategory, EntityState, Result
from simulation_interfaces.srv import GetEntityState, SetEntityState
from std_msgs.msg import Header

from simulation_interfaces_tck.clause import clause
from simulation_interfaces_tck.client import fail
from simulation_interfaces_tck.scene import OK, PAUSED, SimulatorScene
from simulation_interfaces_tck.shapes import distance, is_unit, pose_at, turn

NOT_FOUND = Result.RESULT_NOT_FOUND
STATIC = EntityCategory.CATEGORY_STATIC_OBJECT
MOVING = (EntityCategory.CATEGORY_ROBOT, EntityCategory.CATEGORY_DYNAMIC_OBJECT)
PUSHED = Vector3(x=1.0)


def set_state(scene: SimulatorScene, name: str, codes: int, state: Any, **flags: bool) -> None:
    """Set a state; the result must be a code."""
    request = {"entity": name, "state": state, **flags}
    scene.simulator.check(
        codes,
        scene.simulator.call(SetEntityState, **request).result,
        "SetEntityState",
        SetEntityState.Response,
        request,
    )


def must_be_at(scene: SimulatorScene, name: str, pose: Any) -> None:
    """Fail unless an entity has a pose."""
    got = scene.pose_of(name).pose
    if distance(got, pose) > scene.tolerance or turn(got, pose) > scene.tolerance:
        fail(f"GetEntityState: expected {pose}, got {got}")


@clause("Result.msg: RESULT_NOT_FOUND", "ENTITY_STATE_GETTING")
def test_state_of_an_unknown_entity_is_not_found(scene: SimulatorScene) -> None:
    """An entity that does not exist has no state."""
    scene.simulator.expect(NOT_FOUND, GetEntityState, entity=scene.new_name())


@clause("EntityState.msg: pose", "ENTITY_STATE_GETTING")
def test_pose_is_valid(scene: SimulatorScene) -> None:
    """A pose has finite numbers and a quaternion of length 1."""
    pose = scene.pose_of(scene.entity()).pose
    numbers = (pose.position.x, pose.position.y, pose.position.z)
    if not is_unit(pose.orientation) or not all(map(math.isfinite, numbers)):
        fail(f"GetEntityState: expected finite numbers and a quaternion of length 1, got {pose}")


@clause("Result.msg: RESULT_NOT_FOUND", "ENTITY_STATE_SETTING")
def test_state_of_an_unknown_entity_is_not_set(scene: SimulatorScene) -> None:
    """The state of an entity that does not exist can't be set."""
    name = scene.new_name()
    set_state(scene, name, NOT_FOUND, EntityState(), set_pose=True)


@clause("SetEntityState.srv: set_pose", "ENTITY_STATE_SETTING", needs=["ENTITY_STATE_GETTING"])
def test_pose_that_was_set_is_read_back(scene: SimulatorScene) -> None:
    """The pose changes at once."""
    scene.hold_still()
    name = scene.entity()
    pose = pose_at(scene.new_place(), heading=1.0)
    set_state(scene, name, OK, EntityState(pose=pose), set_pose=True)
    must_be_at(scene, name, pose)


@clause("SetEntityState.srv: set_pose", "ENTITY_STATE_SETTING", needs=["ENTITY_STATE_GETTING"])
def test_pose_is_ignored_without_its_flag(scene: SimulatorScene) -> None:
    """Without set_pose, the pose of the request is ignored."""
    scene.hold_still()
    name = scene.entity()
    before = scene.pose_of(name).pose
    state = EntityState(pose=pose_at(scene.new_place()))
    set_state(scene, name, OK, state, set_pose=False, set_twist=True)
    must_be_at(scene, name, before)


@clause("SetEntityState.srv: state", "ENTITY_STATE_SETTING", needs=["ENTITY_STATE_GETTING"])
def test_stamp_of_a_state_is_ignored(scene: SimulatorScene) -> None:
    """The time stamp of the new state does not matter."""
    scene.hold_still()
    name = scene.entity()
    pose = pose_at(scene.new_place())
    header = Header(stamp=Time(sec=2_000_000_000))
    set_state(scene, name, OK, EntityState(header=header, pose=pose), set_pose=True)
    must_be_at(scene, name, pose)


@clause(
    "SetEntityState.srv: set_twist",
    "ENTITY_STATE_SETTING",
    needs=["ENTITY_STATE_GETTING", "ENTITY_INFO_GETTING", "SIMULATION_STATE_PAUSE"],
)
def test_twist_that_was_set_is_read_back(scene: SimulatorScene) -> None:
    """The twist changes at once; the simulation is paused, so that nothing brakes it."""
    scene.bring_to(PAUSED)
    name = scene.spawn_of(MOVING)
    state = EntityState(twist=Twist(linear=Vector3(x=0.5)))
    set_state(scene, name, OK, state, set_twist=True)
    got = scene.pose_of(name).twist.linear
    if math.dist((got.x, got.y), (0.5, 0.0)) > scene.tolerance:
        fail(f"GetEntityState: expected a linear velocity of x=0.5, got {got}")


@clause(
    "SetEntityState.srv: set_twist",
    "ENTITY_STATE_SETTING",
    needs=["ENTITY_STATE_GETTING", "SIMULATION_STATE_PAUSE"],
)
def test_twist_is_ignored_without_its_flag(scene: SimulatorScene) -> None:
    """Without set_twist, the twist of the request is ignored."""
    scene.bring_to(PAUSED)
    name = scene.entity()
    before = scene.pose_of(name)
    state = EntityState(pose=before.pose, twist=Twist(linear=Vector3(x=0.5)))
    set_state(scene, name, OK, state, set_pose=True)
    got = scene.pose_of(name).twist.linear
    if math.dist((got.x, got.y), (before.twist.linear.x, before.twist.linear.y)) > scene.tolerance:
        fail(f"GetEntityState: expected the linear velocity of before, got {got}")


@pytest.mark.parametrize(
    "pose",
    [
        pytest.param(pose_at((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)), id="zero_quaternion"),
        pytest.param(pose_at((0.0, 0.0, 0.0), (math.nan, 0.0, 0.0, 1.0)), id="nan_in_quaternion"),
        pytest.param(pose_at((math.nan, 0.0, 0.0)), id="nan_in_position"),
    ],
)
@clause("SetEntityState.srv: INVALID_POSE", "ENTITY_STATE_SETTING")
def test_invalid_pose_is_not_set(scene: SimulatorScene, pose: Any) -> None:
    """A pose that is none is refused, and the entity stays where it is."""
    scene.hold_still()
    name = scene.entity()
    is_read = "ENTITY_STATE_GETTING" in scene.simulator.announced
    before = scene.pose_of(name).pose if is_read else None
    code = SetEntityState.Response.INVALID_POSE
    set_state(scene, name, code, EntityState(pose=pose), set_pose=True)
    if before is not None:
        must_be_at(scene, name, before)


@pytest.fixture
def static(scene: SimulatorScene) -> str:
    """Find an entity of CATEGORY_STATIC_OBJECT."""
    scene.simulator.need("ENTITY_INFO_GETTING")
    return scene.entity_of(STATIC)


@pytest.mark.parametrize(
    ("flag", "state"),
    [
        pytest.param("set_twist", EntityState(twist=Twist(linear=PUSHED)), id="twist"),
        pytest.param(
            "set_acceleration", EntityState(acceleration=Accel(linear=PUSHED)), id="acceleration"
        ),
    ],
)
@clause("SetEntityState.srv: state", "ENTITY_STATE_SETTING")
def test_static_object_is_not_moved(
    scene: SimulatorScene, static: str, flag: str, state: Any
) -> None:
    """A twist or an acceleration that is not zero is refused for a static object."""
    set_state(scene, static, Result.RESULT_OPERATION_FAILED, state, **{flag: True})
