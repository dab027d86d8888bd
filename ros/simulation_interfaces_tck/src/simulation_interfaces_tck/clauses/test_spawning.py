# SPDX-License-Identifier: Apache-2.0
"""Spawning an entity, by SpawnEntity and by SpawnEntities alike."""

import math
from pathlib import Path

import pytest
from builtin_interfaces.msg import Time
from simulation_interfaces.msg import Resource, SpawnResult

from simulation_interfaces_tck.clause import clause
from simulation_interfaces_tck.client import fail, not_tested
from simulation_interfaces_tck.scene import OK, SimulatorScene
from simulation_interfaces_tck.shapes import distance, pose_at, stamped, turn

pytestmark = pytest.mark.parametrize("feature", ["SPAWNING", "SPAWNING_ENTITIES"])

NAME_NOT_UNIQUE = SpawnResult.NAME_NOT_UNIQUE
NAME_INVALID = SpawnResult.NAME_INVALID


@clause("SpawnEntity.msg: name")
def test_spawned_entity_has_the_requested_name(scene: SimulatorScene, feature: str) -> None:
    """A free name is given to the entity, and the entity is then listed."""
    name = scene.new_name()
    spawned = scene.expect_spawn(OK, feature, name=name)
    if spawned.entity_name != name:
        fail(f"expected the entity_name {name!r}, got {spawned.entity_name!r}")
    scene.must_have(name)


@clause("SpawnResult.msg: NAME_NOT_UNIQUE")
def test_taken_name_is_refused_without_renaming(scene: SimulatorScene, feature: str) -> None:
    """A name that an entity has is refused if allow_renaming is false."""
    name = scene.expect_spawn(OK, feature).entity_name
    scene.expect_spawn(NAME_NOT_UNIQUE, feature, name=name)


@clause("SpawnEntity.msg: allow_renaming")
def test_taken_name_is_replaced_with_renaming(scene: SimulatorScene, feature: str) -> None:
    """With allow_renaming, the entity gets a name that no other has."""
    name = scene.expect_spawn(OK, feature).entity_name
    other = scene.expect_spawn(OK, feature, name=name, allow_renaming=True).entity_name
    if not other or other == name:
        fail(f"expected an entity_name other than {name!r}, got {other!r}")
    scene.must_have(name)
    scene.must_have(other)


@clause("SpawnResult.msg: NAME_INVALID")
def test_empty_name_without_renaming_is_refused_or_the_resource_has_one(
    scene: SimulatorScene, feature: str
) -> None:
    """Without a name in the request or in the resource, and without renaming, nothing spawns."""
    spawned = scene.expect_spawn((OK, NAME_INVALID, NAME_NOT_UNIQUE), feature, name="")
    if spawned.result.result == OK and not spawned.entity_name:
        fail("expected NAME_INVALID or an entity_name, got RESULT_OK and an empty entity_name")


@clause("SpawnEntity.msg: name")
def test_empty_name_with_renaming_gets_a_name(scene: SimulatorScene, feature: str) -> None:
    """With allow_renaming, an entity without a name gets one."""
    spawned = scene.expect_spawn(OK, feature, name="", allow_renaming=True)
    if not spawned.entity_name:
        fail("expected a generated entity_name, got an empty one")
    scene.must_have(spawned.entity_name)


@clause("SpawnResult.msg: NAME_INVALID")
def test_unusual_name_is_kept_or_invalid(scene: SimulatorScene, feature: str) -> None:
    """A name with unusual characters is kept, or refused with NAME_INVALID."""
    name = f"{scene.new_name()} with spaces, tabs\tand *"
    spawned = scene.expect_spawn((OK, NAME_INVALID), feature, name=name)
    if spawned.result.result == OK and spawned.entity_name != name:
        fail(f"expected the entity_name {name!r} or NAME_INVALID, got {spawned.entity_name!r}")


@clause("SpawnResult.msg: NO_RESOURCE")
def test_request_without_resource_is_refused(scene: SimulatorScene, feature: str) -> None:
    """Uri and resource string may not both be empty."""
    scene.expect_spawn(SpawnResult.NO_RESOURCE, feature, entity_resource=Resource())


@clause("Resource.msg: resource_string")
def test_resource_string_is_ignored_beside_a_uri(scene: SimulatorScene, feature: str) -> None:
    """If the uri is not empty, the resource string does not matter."""
    if not scene.resource.uri:
        not_tested("the spawnable resource has no uri; name one with --spawnable")
    both = Resource(uri=scene.resource.uri, resource_string="<no resource")
    scene.expect_spawn(OK, feature, entity_resource=both)


@clause("SpawnResult.msg: UNSUPPORTED_FORMAT")
def test_unknown_format_is_refused(scene: SimulatorScene, feature: str, tmp_path: Path) -> None:
    """A file whose format is not among the supported ones is refused as that."""
    file = tmp_path / "model.tck"
    file.write_text("no format that a simulator knows\n")
    resource = Resource(uri=file.as_uri())
    scene.expect_spawn(SpawnResult.UNSUPPORTED_FORMAT, feature, entity_resource=resource)


@clause("SpawnResult.msg: RESOURCE_PARSE_ERROR")
def test_malformed_file_is_refused(scene: SimulatorScene, feature: str, tmp_path: Path) -> None:
    """A file of a supported format that can't be parsed is refused as that."""
    suffix, text = scene.definitions.broken()
    file = tmp_path / f"model{suffix}"
    file.write_text(text)
    resource = Resource(uri=file.as_uri())
    scene.expect_spawn(SpawnResult.RESOURCE_PARSE_ERROR, feature, entity_resource=resource)


@clause("SpawnResult.msg: NAMESPACE_INVALID")
def test_invalid_namespace_is_refused(scene: SimulatorScene, feature: str) -> None:
    """A namespace that is none of ROS is refused."""
    scene.expect_spawn(SpawnResult.NAMESPACE_INVALID, feature, entity_namespace="1 is/no*namespace")


@clause("SpawnEntity.msg: entity_namespace")
def test_entity_in_a_namespace_is_listed_as_it_is_answered(
    scene: SimulatorScene, feature: str
) -> None:
    """The entity_name that is answered is the name in the list."""
    name = scene.new_name()
    spawned = scene.expect_spawn(OK, feature, name=name, entity_namespace="tck_namespace")
    if not spawned.entity_name.endswith(name):
        fail(f"expected an entity_name that ends in {name!r}, got {spawned.entity_name!r}")
    scene.must_have(spawned.entity_name)


@pytest.mark.parametrize(
    "pose",
    [
        pytest.param(pose_at((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)), id="zero_quaternion"),
        pytest.param(pose_at((0.0, 0.0, 0.0), (math.nan, 0.0, 0.0, 1.0)), id="nan_in_quaternion"),
        pytest.param(pose_at((math.nan, 0.0, 0.0)), id="nan_in_position"),
    ],
)
@clause("SpawnResult.msg: INVALID_POSE")
def test_invalid_pose_is_refused(scene: SimulatorScene, feature: str, pose: object) -> None:
    """A pose that is none is refused, and nothing is spawned."""
    name = scene.new_name()
    wanted = {"name": name, "initial_pose": stamped(pose)}
    scene.expect_spawn(SpawnResult.INVALID_POSE, feature, **wanted)
    scene.must_lack(name)


@clause("SpawnEntity.msg: initial_pose", needs=["ENTITY_STATE_GETTING"])
def test_entity_is_where_it_was_spawned(scene: SimulatorScene, feature: str) -> None:
    """An initial pose without a frame is in the world frame."""
    scene.hold_still()
    pose = pose_at(scene.new_place(), heading=0.5)
    name = scene.expect_spawn(OK, feature, initial_pose=stamped(pose)).entity_name
    got = scene.pose_of(name).pose
    if distance(got, pose) > scene.tolerance or turn(got, pose) > scene.tolerance:
        fail(f"expected {pose}, got {got}")


@clause("SpawnEntity.msg: initial_pose")
def test_stamp_of_the_initial_pose_is_ignored(scene: SimulatorScene, feature: str) -> None:
    """The time stamp of the initial pose does not matter."""
    pose = stamped(pose_at(scene.new_place()))
    pose.header.stamp = Time(sec=2_000_000_000)
    scene.expect_spawn(OK, feature, initial_pose=pose)


@clause("SpawnEntity.msg: initial_pose")
def test_unknown_frame_is_refused(scene: SimulatorScene, feature: str) -> None:
    """A reference frame that the simulator does not know is refused."""
    pose = stamped(pose_at(scene.new_place()), frame="tck_frame_that_does_not_exist")
    spawned = scene.try_spawn(feature, initial_pose=pose)
    if spawned.result.result == OK:
        fail("expected a refusal of the unknown frame, got RESULT_OK")


@clause("SimulatorFeatures.msg: SPAWNING_RESOURCE_STRING", "SPAWNING_RESOURCE_STRING")
def test_resource_string_is_spawned(scene: SimulatorScene, feature: str) -> None:
    """A definition that comes as a string is spawned."""
    scene.simulator.need(feature)
    text = scene.definitions.whole()
    name = scene.new_name()
    scene.expect_spawn(OK, feature, name=name, entity_resource=Resource(resource_string=text))
    scene.must_have(name)


@clause("SpawnResult.msg: RESOURCE_PARSE_ERROR", "SPAWNING_RESOURCE_STRING")
def test_malformed_resource_string_is_refused(scene: SimulatorScene, feature: str) -> None:
    """A string of a supported format that can't be parsed is refused as that."""
    scene.simulator.need(feature)
    _, text = scene.definitions.broken()
    resource = Resource(resource_string=text)
    code = SpawnResult.RESOURCE_PARSE_ERROR
    scene.expect_spawn(code, feature, entity_resource=resource)
