# SPDX-License-Identifier: Apache-2.0
"""A recorded scenario with changes is what its file gives with them."""

import pytest

from groundlink.core.errors import UserError
from groundlink.loader import load
from groundlink.loader.overrides import field_changes
from groundlink.loader.recorded_scenario import with_changes
from groundlink.loader.scenario_files import SHIPPED


@pytest.mark.parametrize("name", sorted(file.stem for file in SHIPPED.glob("*.yaml")))
def test_without_changes_it_stays_what_it_is(name: str) -> None:
    assert with_changes(load(name), []) == load(name)


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("indoor_lab", "lidar.dropout=0.1"),
        ("indoor_lab", "rover/lidar.dropout=0.1"),
        ("indoor_lab", "rover/lidar.datasheet=sensors/os1_64.yaml"),
        ("indoor_lab", "camera.datasheet=camera_fisheye"),
        ("indoor_lab", "lidar.mount=camera"),
        ("indoor_lab", "lidar.mount={xyz_m: [0.1, 0.0, 0.9]}"),
        ("indoor_lab", "world.weather={fog_visibility_m: 30.0}"),
        ("indoor_lab", "lidar.faults=[{kind: 'off', at_s: 0.5}]"),
        ("two_rovers", "second.scanner.topic=other_scan"),
    ],
)
def test_changes_have_the_effect_that_they_have_in_its_file(name: str, change: str) -> None:
    changes = field_changes([change])
    assert with_changes(load(name), changes) == load(name, changes=changes) != load(name)


def test_a_mistake_is_one_line() -> None:
    with pytest.raises(UserError, match=r"the recorded scenario:1: .*dropout"):
        with_changes(load("indoor_lab"), field_changes(["lidar.dropout=none"]))
