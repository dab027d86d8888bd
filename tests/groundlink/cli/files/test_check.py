# SPDX-License-Identifier: Apache-2.0
"""`groundlink check` says what a scenario would start."""

from pathlib import Path

import pytest

from groundlink.__main__ import main
from groundlink.loader.scenario_files import SHIPPED


@pytest.mark.parametrize("command", ["check", "up"])
def test_a_topic_that_ros_cannot_answer_is_told(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "lab.yaml"
    lab = (SHIPPED / "indoor_lab.yaml").read_text(encoding="utf-8")
    file.write_text(lab + "\ntime: {answers: {/cmd_vel: /odmo}}\n", encoding="utf-8")
    assert main([command, str(file)]) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert "`time.answers`: /cmd_vel cannot answer /odmo" in line
    assert "/clock, /imu, " in line


@pytest.mark.parametrize(("name", "drives"), [("indoor_lab", False), ("indoor_lab_tour", True)])
def test_a_route_is_told_with_its_length(
    name: str, drives: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(SHIPPED / f"{name}.yaml")]) == 0
    assert ("route    rover/driver: 44.6 m at 0.6 m/s" in capsys.readouterr().out) is drives
