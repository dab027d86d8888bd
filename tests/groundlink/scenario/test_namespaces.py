# SPDX-License-Identifier: Apache-2.0
"""Vehicles in company have topics, commands and frames of their own; one that is alone has none."""

from __future__ import annotations

from pathlib import Path

import pytest

from groundlink.scenario import load
from groundlink.scenario.document import ScenarioError

VEHICLE = """
  - name: {name}
    model: vehicles/rover.yaml
    placement: {{x_m: {x}, y_m: -10.0}}
    sensors: [{{kind: imu, name: imu, topic: {topic}, frame: imu_link, mount: imu}}]
    from_ros: {{pose: {pose}}}
    {more}
"""


def scenario(folder: Path, *vehicles: str) -> Path:
    file = folder / "some.yaml"
    file.write_text("name: some\nworld: worlds/yard.yaml\nvehicles:" + "".join(vehicles))
    return file


def vehicle(
    name: str, x: float = 0.0, *, topic: str = "imu", pose: str = "pose", more: str = ""
) -> str:
    return VEHICLE.format(name=name, x=x, topic=topic, pose=pose, more=more)


def test_one_that_is_alone_has_no_namespace(tmp_path: Path) -> None:
    (rover,) = load(scenario(tmp_path, vehicle("rover"))).vehicles
    assert (rover.namespace, rover.frame_prefix, rover.command_topic) == ("", "", "/cmd_vel")
    assert (rover.sensors[0].topic, rover.from_ros.pose) == ("/imu", "/pose")


def test_those_in_company_are_kept_apart_by_their_names(tmp_path: Path) -> None:
    made = load(scenario(tmp_path, vehicle("one"), vehicle("two", 5.0, topic="/left/imu")))
    one, two = made.vehicles
    assert (one.namespace, one.frame_prefix, one.command_topic) == ("/one", "one/", "/one/cmd_vel")
    assert (one.sensors[0].topic, one.from_ros.pose) == ("/one/imu", "/one/pose")
    assert (two.sensors[0].topic, two.from_ros.pose) == ("/left/imu", "/two/pose")
    assert made.ground_truth_topic(two) == "/two/ground_truth/odom"


def test_a_scenario_may_name_them_otherwise(tmp_path: Path) -> None:
    more = "{namespace: /fleet/a, frame_prefix: a_, command_topic: teleop}"
    file = scenario(
        tmp_path, vehicle("one"), vehicle("two", 5.0, more=more[1:-1].replace(", ", "\n    "))
    )
    _, two = load(file).vehicles
    assert (two.frame_prefix, two.command_topic) == ("a_", "/fleet/a/teleop")
    assert two.sensors[0].topic == "/fleet/a/imu"


@pytest.mark.parametrize("more", ["command_topic: /one/cmd_vel", "command_topic: /one/imu"])
def test_two_that_share_a_topic_of_commands_are_refused(tmp_path: Path, more: str) -> None:
    with pytest.raises(ScenarioError, match=r"`/one/.*give each its own"):
        load(scenario(tmp_path, vehicle("one"), vehicle("two", 5.0, more=more)))


@pytest.mark.parametrize("namespace", ["fleet", "/", "/a b", "7"])
def test_what_is_no_namespace_is_refused(tmp_path: Path, namespace: str) -> None:
    with pytest.raises(ScenarioError, match=r"some.yaml:\d+: `vehicles\[0\].namespace`"):
        load(scenario(tmp_path, vehicle("one", more=f"namespace: {namespace}")))


def test_an_alias_that_holds_itself_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="does an alias hold itself"):
        load(scenario(tmp_path, vehicle("one", more="streams: &streams [*streams]")))
