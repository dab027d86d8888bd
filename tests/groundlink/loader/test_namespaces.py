# SPDX-License-Identifier: Apache-2.0
"""Several vehicles have namespaced topics, commands and frames; a single vehicle has none."""

from pathlib import Path

import pytest

from groundlink.loader import load
from groundlink.loader.document import ScenarioError

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


def test_a_single_vehicle_has_no_namespace(tmp_path: Path) -> None:
    (rover,) = load(scenario(tmp_path, vehicle("rover"))).vehicles
    assert (rover.namespace, rover.frame_prefix, rover.command_topic) == ("", "", "/cmd_vel")
    assert (rover.sensors[0].topic, rover.from_ros.pose) == ("/imu", "/pose")


def test_sensors_of_one_process_differ_by_name(tmp_path: Path) -> None:
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


def test_further_topics_are_in_the_namespace_too_and_types_as_either_ros_writes_them(
    tmp_path: Path,
) -> None:
    further = "pose, topics: {plan: nav_msgs/msg/Path, /fleet: nav_msgs/Path}"
    file = scenario(tmp_path, vehicle("one", pose=further), vehicle("two", 5.0))
    one, _ = load(file).vehicles
    assert one.from_ros.topics == {"/one/plan": "nav_msgs/Path", "/fleet": "nav_msgs/Path"}


@pytest.mark.parametrize(
    ("further", "complaint"),
    [
        (
            "{plan: nav_msgs/Paths}",
            r"some.yaml:\d+: .*topics\..*/plan`: unknown value "
            "`nav_msgs/Paths`; did you mean `nav_msgs/Path`",
        ),
        ("{plan: 7}", r"some.yaml:\d+: .*/plan`: expected `str`"),
        ("[plan]", r"some.yaml:\d+: `vehicles\[0\].from_ros.topics`: expected `object`"),
        ("{/a b: nav_msgs/Path}", r"some.yaml:\d+: .*topics"),
        ("{pose: nav_msgs/Path}", "`from_ros` of `one`: the topic `/pose` is taken by"),
        ("{imu: sensor_msgs/Imu}", "`from_ros` of `one`: the topic `/imu` is taken by `one/imu`"),
        ("{/tf: tf2_msgs/TFMessage}", "the topic `/tf` is taken by the gateway"),
    ],
)
def test_what_is_no_further_topic_is_one_line(tmp_path: Path, further: str, complaint: str) -> None:
    file = scenario(tmp_path, vehicle("one", pose=f"pose, topics: {further}"))
    with pytest.raises(ScenarioError, match=complaint) as raised:
        load(file)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("more", ["command_topic: /one/cmd_vel", "command_topic: /one/imu"])
def test_two_that_share_a_topic_of_commands_are_refused(tmp_path: Path, more: str) -> None:
    with pytest.raises(ScenarioError, match=r"`/one/.*` is taken by .*`one.*choose another topic"):
        load(scenario(tmp_path, vehicle("one"), vehicle("two", 5.0, more=more)))


@pytest.mark.parametrize("namespace", ["fleet", "/", "/a b", "7"])
def test_invalid_namespace_is_refused(tmp_path: Path, namespace: str) -> None:
    with pytest.raises(ScenarioError, match=r"some.yaml:\d+: `vehicles\[0\].namespace`"):
        load(scenario(tmp_path, vehicle("one", more=f"namespace: {namespace}")))


def test_an_alias_that_holds_itself_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="does an alias hold itself"):
        load(scenario(tmp_path, vehicle("one", more="streams: &streams [*streams]")))
