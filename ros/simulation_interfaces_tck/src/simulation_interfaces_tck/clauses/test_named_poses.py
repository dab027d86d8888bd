# SPDX-License-Identifier: Apache-2.0
"""Named poses and their tags."""

import pytest
from simulation_interfaces.msg import TagsFilter
from simulation_interfaces.srv import GetNamedPoses

from simulation_interfaces_tck.clause import clause
from simulation_interfaces_tck.client import fail, not_tested
from simulation_interfaces_tck.scene import OK, SimulatorScene
from simulation_interfaces_tck.shapes import is_unit

MODES = {"any": TagsFilter.FILTER_MODE_ANY, "all": TagsFilter.FILTER_MODE_ALL}


@clause("NamedPose.msg: name", "NAMED_POSES")
def test_names_of_poses_are_unique(scene: SimulatorScene) -> None:
    """No name is empty or listed twice."""
    names = [pose.name for pose in scene.simulator.expect(OK, GetNamedPoses).poses]
    if len({*names}) != len(names) or "" in names:
        fail(f"GetNamedPoses: expected unique names, got {names}")


@clause("NamedPose.msg: pose", "NAMED_POSES")
def test_named_poses_are_valid(scene: SimulatorScene) -> None:
    """Each quaternion is of length 1."""
    for pose in scene.simulator.expect(OK, GetNamedPoses).poses:
        if not is_unit(pose.pose.orientation):
            fail(
                f"GetNamedPoses: {pose.name!r}: expected a quaternion of length 1, got {pose.pose}"
            )


@pytest.mark.parametrize("mode", MODES)
@clause("GetNamedPoses.srv: tags", "NAMED_POSES")
def test_named_poses_are_filtered_by_tags(scene: SimulatorScene, mode: str) -> None:
    """Only poses with any or all of the tags are listed."""
    poses = scene.simulator.expect(OK, GetNamedPoses).poses
    tags = sorted({tag for pose in poses for tag in pose.tags})
    if not tags:
        not_tested("no named pose has a tag")
    for wanted in ([tags[0]], [tags[-1], tags[0]], [tags[0], "tck_tag_of_none"]):
        match = any if mode == "any" else all
        expected = {pose.name for pose in poses if match(tag in pose.tags for tag in wanted)}
        only = TagsFilter(tags=wanted, filter_mode=MODES[mode])
        got = {pose.name for pose in scene.simulator.expect(OK, GetNamedPoses, tags=only).poses}
        if got != expected:
            fail(f"GetNamedPoses: {mode} of {wanted}: expected {expected}, got {got}")
