# SPDX-License-Identifier: Apache-2.0
"""Without a clone: `pip install groundlink[all]` from wheels, and the first commands."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.building import build_wheels, pip

pytestmark = [pytest.mark.system, pytest.mark.timeout(400)]

COMMANDS = (
    "demo --duration 3",
    "new my_scenario",
    "check my_scenario.yaml",
    "record my_scenario.yaml --out run.mcap --duration 1",
    "report run.mcap",
)


def test_an_empty_folder_and_a_new_environment_are_enough(tmp_path: Path) -> None:
    source, here, environment = (tmp_path / name for name in ("source", "here", "environment"))
    source.mkdir()
    here.mkdir()
    wheels = build_wheels(source)
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", environment], check=True)
    ours = ("--find-links", wheels, "groundlink[all]")
    pip("--python", environment / "bin" / "python", "install", "--no-compile", *ours)
    variables = os.environ.keys() - {"PYTHONPATH", "DISPLAY", "WAYLAND_DISPLAY"}
    said = {}
    for command in COMMANDS:
        done = subprocess.run(
            [environment / "bin" / "groundlink", *command.split()],
            cwd=here,
            env={name: os.environ[name] for name in variables},
            capture_output=True,
            text=True,
            timeout=90,
            check=False,
        )
        said[command] = done.stdout + done.stderr
        assert done.returncode == 0, said[command]
    assert "view: open http://127.0.0.1:" in said["demo --duration 3"]
    assert "using a plain UDP Bridge receiver" in said["demo --duration 3"]
    assert {file.name for file in here.iterdir()} == {"my_scenario.yaml", "run.mcap", "run.html"}
