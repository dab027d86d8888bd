# SPDX-License-Identifier: Apache-2.0
"""The packages as the tools of ROS find and install them, by the files alone."""

import ast
import importlib
import os
import re
import shlex
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest
import yaml

from groundlink.cli.commands import parser
from udp_bridge.node.bridge_node import Settings

ROS = Path(__file__).resolve().parents[2] / "ros"
ROS2 = ROS / "ros2/udp_bridge_ros2"
MANIFESTS = sorted(ROS.rglob("package.xml"))
MARKERS = {"AMENT_IGNORE", "CATKIN_IGNORE", "COLCON_IGNORE"}
"""Today's catkin passes over folders with any of them; colcon over those with the last, and over
packages with one of the others."""


def found_below(folder: Path) -> set[str]:
    """Return the folders of the packages that a workspace with this folder has."""
    found = set()
    for place, folders, files in os.walk(folder):
        if MARKERS & set(files):
            folders.clear()
        elif "package.xml" in files:
            folders.clear()
            found.add(str(Path(place).relative_to(ROS)))
    return found


def test_a_workspace_finds_the_packages_of_its_ros_and_no_others() -> None:
    assert found_below(ROS) == {"groundlink_msgs", "ros2/udp_bridge_ros2", "udp_bridge_cpp"}
    linked = [folder for folder in (ROS / "ros1").iterdir() if (folder / "package.xml").exists()]
    assert {str(folder.relative_to(ROS)) for folder in linked} == set().union(
        *(found_below(folder) for folder in linked)
    )


@pytest.mark.parametrize("manifest", MANIFESTS, ids=lambda file: str(file.relative_to(ROS)))
def test_manifest_is_complete(manifest: Path) -> None:
    root = ET.parse(manifest).getroot()
    assert root.get("format") == "3"
    assert root.findtext("name") == manifest.parent.name
    for tag in ("version", "description", "maintainer", "license"):
        assert root.findtext(tag), tag


def test_what_setup_installs_is_there_and_its_command_runs() -> None:
    text = (ROS2 / "setup.py").read_text()
    named = re.findall(r'"((?:config|launch|rviz)/[^"]+)"', text)
    assert set(named) == {
        str(file.relative_to(ROS2))
        for folder in ("config", "launch", "rviz")
        for file in (ROS2 / folder).iterdir()
    }
    assert (ROS2 / "resource" / ROS2.name).exists()
    module, _, name = "udp_bridge_ros2.__main__:main".partition(":")
    assert "{NAME}.__main__:main" in text
    assert callable(getattr(importlib.import_module(module), name))


def test_the_launch_files_name_what_is_there() -> None:
    ros2 = ET.parse(ROS2 / "launch/bridge.launch.xml").getroot()
    whole = ET.parse(ROS2 / "launch/run.launch.xml").getroot()
    ros1_folder = ROS / "ros1/udp_bridge_ros1"
    ros1 = ET.parse(ros1_folder / "launch/bridge.launch").getroot()
    for root, share, folder in (
        (ros2, "$(find-pkg-share udp_bridge_ros2)/", ROS2),
        (whole, "$(find-pkg-share udp_bridge_ros2)/", ROS2),
        (ros1, "$(find udp_bridge_ros1)/", ros1_folder),
    ):
        text = ET.tostring(root, encoding="unicode")
        paths = re.findall(re.escape(share) + r'([^"\s]+)', text)
        assert paths
        assert all((folder / path).exists() for path in paths)
        declared = {arg.get("name") for arg in root.findall("arg")}
        assert declared == set(re.findall(r"\$\((?:var|arg) (\w+)\)", text))


def test_the_launch_file_of_a_run_has_a_command_and_arguments_that_exist() -> None:
    bridge = ET.parse(ROS2 / "launch/bridge.launch.xml").getroot()
    run = ET.parse(ROS2 / "launch/run.launch.xml").getroot()
    passed = {arg.get("name") for include in run.iter("include") for arg in include.iter("arg")}
    assert passed <= {arg.get("name") for arg in bridge.findall("arg")}
    values = {str(arg.get("name")): str(arg.get("default")) for arg in run.findall("arg")}
    values |= {"scenario": "mine.yaml", "options": "--duration 20 --record run.mcap"}
    (executable,) = run.iter("executable")
    command = re.sub(r"\$\(var (\w+)\)", lambda found: values[found[1]], str(executable.get("cmd")))
    first, name, *words = shlex.split(command)
    assert (first, name) == ("exec", "groundlink")
    options = parser().parse_args(words)
    assert (options.scenario, options.duration, options.no_ros) == ("mine.yaml", 20.0, True)


def test_the_file_of_parameters_has_the_defaults_of_the_node() -> None:
    declared: dict[str, Any] = dict(Settings()._asdict())
    for file in (ROS2 / "udp_bridge_ros2").glob("*.py"):
        for call in ast.walk(ast.parse(file.read_text())):
            if isinstance(call, ast.Call) and getattr(call.func, "attr", "") == "declare_parameter":
                name, default = call.args[0], call.args[1]
                if isinstance(name, ast.Constant):  # the others are those of Settings
                    declared[name.value] = getattr(default, "value", None)
    (written,) = yaml.safe_load((ROS2 / "config/bridge.yaml").read_text()).values()
    assert written["ros__parameters"].keys() == declared.keys() - {"bind"}
    for name, value in written["ros__parameters"].items():
        assert declared[name] == value, name


@pytest.mark.parametrize("file", sorted(ROS.rglob("*.rviz")), ids=lambda file: str(file.parts[-3]))
def test_rviz_shows_the_topics_of_the_scenarios(file: Path) -> None:
    displays = yaml.safe_load(file.read_text())["Visualization Manager"]["Displays"]
    topics = {
        topic["Value"] if isinstance(topic, dict) else topic
        for row in displays
        if (topic := row.get("Topic", row.get("Image Topic")))
    }
    (robot,) = (row for row in displays if row["Class"].endswith("/RobotModel"))
    described = robot.get("Robot Description") or robot["Description Topic"]["Value"]
    assert described.strip("/") == "robot_description"
    (camera,) = (topic for topic in topics if topic.startswith("/camera/image_raw"))
    assert topics == {"/points", "/scan", camera, "/odom", "/map"}
