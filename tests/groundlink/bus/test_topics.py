# SPDX-License-Identifier: Apache-2.0
"""The table of topics holds together: every row is used, and keys never clash."""

import re
from pathlib import Path
from typing import get_args, get_type_hints

import groundlink
from groundlink.bus import topics
from groundlink.bus.core_topics import HEALTH
from groundlink.bus.topics import FROM_ROS, SENSOR_TOPICS, STREAM_TOPICS, TOPICS, process_names
from groundlink.loader import load
from groundlink.messages import base as messages
from groundlink.messages import ground_truth, navigation
from groundlink.ros.cdr import ROS_CODECS
from groundlink.scenario.ros_side import FromRos, Stream
from groundlink.scenario.schema import RESERVED_NAMES, RESERVED_SENSOR_NAMES


def test_every_message_of_the_bus_has_a_row() -> None:
    only_from_the_gateway = {navigation.Text}
    of_the_bus = messages.all_messages() - only_from_the_gateway
    assert {topic.message for topic in TOPICS} == of_the_bus


def test_first_words_of_keys_are_reserved() -> None:
    words = {topic.key.split("/")[0] for topic in TOPICS} - {"{vehicle}"}
    assert words | {"scenario", "link", "control", "world", "assets", "journal"} == RESERVED_NAMES
    last = {topic.key.split("/")[1] for topic in TOPICS if topic.key.startswith("{vehicle}/")}
    assert last - {"{sensor}"} | {"driver"} == RESERVED_SENSOR_NAMES


def test_every_kind_of_stream_can_be_declared_and_is_a_ros_message() -> None:
    assert set(get_args(get_type_hints(Stream)["kind"])) == set(STREAM_TOPICS)
    others = {
        *(messages.Clock, messages.Command),
        *(ground_truth.Bodies, ground_truth.TruePoints, navigation.Text),
        *(ground_truth.LabeledPoints, ground_truth.LabelTable),
        *(ground_truth.Detections2D, ground_truth.Detections3D),
    }
    assert {topic.message for topic in STREAM_TOPICS.values()} == set(ROS_CODECS) - others


def test_every_field_of_from_ros_has_a_row() -> None:
    assert {*FROM_ROS, "joint_groups", "topics"} == set(FromRos.__struct_fields__)


def test_unfilled_words_match_everything() -> None:
    assert HEALTH.key_in("lab") == "groundlink/lab/health/**"
    assert (
        topics.SENSOR_TOPICS["lidar"].key_in("lab", vehicle="a", sensor="b") == "groundlink/lab/a/b"
    )


def test_every_kind_of_sensor_is_a_process_and_a_ros_message() -> None:
    folders = Path(groundlink.__file__).parents[1] / "services" / "sensors"
    for topic in SENSOR_TOPICS.values():
        assert (folders / topic.name / "__main__.py").is_file()
        assert topic.message in ROS_CODECS


def test_processes_of_the_shipped_scenario() -> None:
    scenario = load("indoor_lab")
    assert process_names(scenario) == {
        "physics": "services.physics",
        "rover/lidar": "services.sensors.lidar",
        "rover/imu": "services.sensors.imu",
        "rover/encoders": "services.sensors.encoders",
        "rover/camera": "services.sensors.camera",
        "gateway": "services.gateway",
    }
    rates = [s.message_rate_hz for s in scenario.vehicles[0].sensors]
    assert rates == [10.0, 400.0, 50.0, 30.0]


def test_a_route_needs_a_driver() -> None:
    tour = load("indoor_lab_tour")
    assert process_names(tour)["rover/driver"] == "services.driver"


def test_nothing_else_writes_keys_of_the_bus() -> None:
    root = Path(groundlink.__file__).parents[1]
    for folder in ("groundlink", "services"):
        for file in (root / folder).rglob("*.py"):
            if file.name != "topics.py":
                assert not re.search(r'f?"groundlink/', file.read_text(encoding="utf-8")), file
