# SPDX-License-Identifier: Apache-2.0
"""Bounds of entities and of named poses."""

import math
from typing import Any

from simulation_interfaces.msg import Bounds, EntityState, Result
from simulation_interfaces.srv import (
    GetEntityBounds,
    GetNamedPoseBounds,
    GetNamedPoses,
    SetEntityState,
)

from simulation_interfaces_tck.clause import clause
from simulation_interfaces_tck.client import fail, not_tested
from simulation_interfaces_tck.scene import OK, SimulatorScene
from simulation_interfaces_tck.shapes import flaw_of, pose_at

NOT_FOUND = Result.RESULT_NOT_FOUND


def bounds_of(scene: SimulatorScene, name: str) -> Any:
    """Return the bounds of an entity."""
    return scene.simulator.expect(OK, GetEntityBounds, entity=name).bounds


@clause("Result.msg: RESULT_NOT_FOUND", "ENTITY_BOUNDS")
def test_bounds_of_an_unknown_entity_are_not_found(scene: SimulatorScene) -> None:
    """An entity that does not exist has no bounds."""
    scene.simulator.expect(NOT_FOUND, GetEntityBounds, entity=scene.new_name())


@clause("Bounds.msg: points", "ENTITY_BOUNDS")
def test_bounds_of_an_entity_are_a_volume(scene: SimulatorScene) -> None:
    """An entity that was spawned has valid bounds that are not empty."""
    bounds = bounds_of(scene, scene.spawn())
    flaw = "empty" if bounds.type == Bounds.TYPE_EMPTY else flaw_of(bounds)
    if flaw:
        fail(f"GetEntityBounds: {flaw}: {bounds}")


@clause("Bounds.msg: description", "ENTITY_BOUNDS", needs=["ENTITY_STATE_SETTING"])
def test_bounds_are_relative_to_the_entity(scene: SimulatorScene) -> None:
    """Bounds do not change when the entity is moved."""
    scene.hold_still()
    name = scene.spawn()
    before = bounds_of(scene, name)
    scene.new_place()
    state = EntityState(pose=pose_at(scene.new_place()))
    scene.simulator.expect(OK, SetEntityState, entity=name, state=state, set_pose=True)
    after = bounds_of(scene, name)
    pairs = zip(before.points, after.points, strict=False)
    moved = max(math.dist((a.x, a.y, a.z), (b.x, b.y, b.z)) for a, b in pairs)
    if len(before.points) != len(after.points) or moved > scene.tolerance:
        fail(f"GetEntityBounds: expected {before} as before the move, got {after}")


@clause("Result.msg: RESULT_NOT_FOUND", "POSE_BOUNDS")
def test_bounds_of_an_unknown_pose_are_not_found(scene: SimulatorScene) -> None:
    """A pose that does not exist has no bounds."""
    scene.simulator.expect(NOT_FOUND, GetNamedPoseBounds, name=scene.new_name())


@clause("GetNamedPoseBounds.srv: bounds", "POSE_BOUNDS", needs=["NAMED_POSES"])
def test_bounds_of_each_named_pose_are_valid(scene: SimulatorScene) -> None:
    """Each named pose has valid bounds, which may be empty."""
    poses = scene.simulator.expect(OK, GetNamedPoses).poses
    if not poses:
        not_tested("there are no named poses")
    for pose in poses:
        bounds = scene.simulator.expect(OK, GetNamedPoseBounds, name=pose.name).bounds
        if flaw := flaw_of(bounds):
            fail(f"GetNamedPoseBounds: {pose.name!r}: {flaw}: {bounds}")
