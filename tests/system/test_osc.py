# SPDX-License-Identifier: Apache-2.0
"""System tests of `osc.groundlink`: the examples, in the real scenario-execution."""

import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import groundlink

from .rig import REPOSITORY

pytest.importorskip("scenario_execution", reason="scenario-execution is not installed")
pytestmark = pytest.mark.system

EXAMPLES = REPOSITORY / "examples" / "scenario_execution"
GUIDE = REPOSITORY / "docs" / "how-to" / "scenario-execution.md"
PROGRAM = Path(sys.executable).with_name("scenario_execution")
SIMULATION = ("--simulation", "groundlink.sim.osc:GroundlinkSimulation")


def execute(name: str, out: Path, *options: str) -> subprocess.CompletedProcess[str]:
    """Run an example of scenario-execution."""
    command = [PROGRAM, EXAMPLES / name, *SIMULATION, "-o", out, *options]
    return subprocess.run(command, capture_output=True, text=True, timeout=90, check=False)


def verdict(out: Path) -> ElementTree.Element:
    """Return the only test case of the JUnit file."""
    (case,) = ElementTree.parse(out / "test.xml").getroot()
    return case


@pytest.mark.parametrize(("name", "times"), [("fail_sensor", 2), ("spawn", 1)])
def test_an_example_passes_with_equal_recordings(tmp_path: Path, name: str, times: int) -> None:
    recordings = set()
    for number in range(times):
        out = tmp_path / str(number)
        done = execute(f"{name}.osc", out)
        assert done.returncode == 0, done.stdout + done.stderr
        assert verdict(out).find("failure") is None
        recordings.add((out / "run.mcap").read_bytes())
    assert len(recordings) == 1
    if name == "fail_sensor":
        with groundlink.open(out / "run.mcap") as run:
            seconds = (run.array("/imu")["stamp"] - run.start_nanos) / 1e9
            turn = run.array("/imu")["angular_velocity"][:, 2]
        repeated = seconds[1:][turn[1:] == turn[:-1]]
        assert len(repeated) > 50
        assert np.ptp(repeated) == pytest.approx(len(repeated) / 400, abs=0.02)
        assert repeated[-1] < seconds[-1] - 0.2


def test_the_guide_shows_the_examples() -> None:
    guide = GUIDE.read_text(encoding="utf-8")
    (shown,) = re.findall(r"```text title=\"spawn.osc\"\n(.*?)```", guide, re.DOTALL)
    assert EXAMPLES.joinpath("spawn.osc").read_text(encoding="utf-8").endswith(shown)


def test_a_failed_assertion_is_a_failure_in_the_junit_file(tmp_path: Path) -> None:
    """The parameter and the reason are those of the guide."""
    guide = GUIDE.read_text(encoding="utf-8")
    (parameters,) = re.findall(r"```text title=\"strict.yaml\"\n(.*?)```", guide, re.DOTALL)
    (reason,) = re.findall(r"-- (at .*)", guide)
    strict = tmp_path / "strict.yaml"
    strict.write_text(parameters, encoding="utf-8")
    out = tmp_path / "out"
    done = execute("assert.osc", out, "--scenario-parameter-file", str(strict))
    assert done.returncode == 1
    failure = verdict(out).find("failure")
    assert failure is not None
    assert reason in str(failure.text)
    assert reason in done.stdout + done.stderr
