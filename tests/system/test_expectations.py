# SPDX-License-Identifier: Apache-2.0
"""System test of expectations: a live run ends with its verdict, and its recording has the same."""

import json
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from .rig import REPOSITORY, rig

pytestmark = pytest.mark.system

EXPECT = """
expect:
  - {kind: reaches, name: near, place: [-7.0, -4.0], within_m: 0.5}
  - {kind: never_touches}
  - {kind: age, topic: /odom, at_most_ms: 60}
"""


@pytest.mark.timeout(200)
@pytest.mark.parametrize(
    ("place", "verdict"), [("[-7.0, -4.0]", "passed"), ("[-4.0, -4.0], by_s: 2", "failed")]
)
def test_a_run_ends_when_its_verdict_is_known(tmp_path: Path, place: str, verdict: str) -> None:
    drive = REPOSITORY / "tests" / "groundlink" / "expectations" / "drive.yaml"
    text = drive.read_text(encoding="utf-8") + EXPECT.replace("[-7.0, -4.0]", place)
    recording, junit, report = (tmp_path / name for name in ("run.mcap", "junit.xml", "run.json"))
    with rig(tmp_path) as it:
        gateway = it.scenario.read_text(encoding="utf-8").partition("\ngateway:")[2]
        it.scenario.write_text(f"{text}\ngateway:{gateway}", encoding="utf-8")
        up = it.up(
            *("--no-ros", "--until-decided", "--record", str(recording)),
            *("--junit", str(junit), "--report", str(report)),
        )
        assert up.wait(150) == 1, it.log("up.log")  # No ROS side reported an age.
        log = it.log("up.log")
    found = json.loads(report.read_text(encoding="utf-8"))["expectations"]
    assert [one["verdict"] for one in found] == [verdict, "passed", "undecided"], log
    assert found[0]["at_s"] < 5.0
    assert "failed: age /odom: undecided, the ROS side reported no ages" in log
    (suite,) = ElementTree.parse(junit).getroot()
    assert suite.get("errors") == "1"
    assert suite.get("failures") == str(int(verdict == "failed"))
    judged = subprocess.run(
        [sys.executable, "-m", "groundlink", "judge", str(recording), "--json"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert judged.returncode in (0, 1), judged.stderr
    assert json.loads(judged.stdout)["expectations"][0] == found[0]
