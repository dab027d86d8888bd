# SPDX-License-Identifier: Apache-2.0
"""`groundlink check` says what a scenario would start."""

from pathlib import Path
from xml.etree import ElementTree

import pytest

from groundlink.__main__ import main
from groundlink.loader.scenario_files import SHIPPED


@pytest.mark.parametrize(("name", "drives"), [("indoor_lab", False), ("indoor_lab_tour", True)])
def test_route_is_printed_with_its_length(
    name: str, drives: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(SHIPPED / f"{name}.yaml")]) == 0
    assert ("route    rover/driver: 44.6 m at 0.6 m/s" in capsys.readouterr().out) is drives


def test_expectations_are_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "yard"]) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    expected = [["never_touches"], ["never_fails"], ["stays_on_route"]]
    assert [line[1:] for line in lines if line[0] == "expect"] == expected


JOINTS = """
name: joints
world: lab
vehicles:
  - name: cart
    model: rover
    namespace: /cart
    command_topic: /unused
    from_ros: {joints: /joint_commands}
    sensors: [{kind: encoders, name: encoders, topic: /encoders, frame: base_link}]
"""


def test_the_robot_description_is_written_with_the_block_of_ros2_control(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario, out = tmp_path / "joints.yaml", tmp_path / "urdf"
    scenario.write_text(JOINTS, encoding="utf-8")
    command = ["check", str(scenario), "--urdf", str(out)]
    assert main(command) == 0
    robot = ElementTree.parse(out / "cart.urdf").getroot()
    block = robot.find("ros2_control")
    assert block is not None
    topics = {param.get("name"): param.text for param in block.iter("param")}
    assert topics["joint_commands_topic"] == "/joint_commands"
    assert topics["joint_states_topic"] == "/cart/joint_states"
    joints = {joint.get("name") for joint in robot.findall("joint")}
    assert {joint.get("name") for joint in block.iter("joint")} <= joints
    capsys.readouterr()
    assert main(command) == 2
    assert "cart.urdf: file exists" in capsys.readouterr().err
