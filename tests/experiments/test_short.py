# SPDX-License-Identifier: Apache-2.0
"""The short run: a drive through the whole chain into a ROS bag, a SLAM program of others on it.

`make test-nightly` installs the programs before the tests: no test fetches anything.
"""

import subprocess
import sys
from pathlib import Path

import pytest

from experiments.estimation.environments import is_installed
from experiments.estimation.evaluation import read_csv
from experiments.estimation.programs import EVO, YAG_SLAM
from experiments.experiment import OUT
from experiments.recording.setups import ROOT

pytest.importorskip("rclpy", reason="no ROS 2 here")
pytest.importorskip("tf2_msgs", reason="no ROS 2 messages here")
pytestmark = [pytest.mark.nightly, pytest.mark.timeout(400)]


def test_a_short_drive_is_mapped(tmp_path: Path) -> None:
    if not all(is_installed(program, OUT) for program in (YAG_SLAM, EVO)):
        pytest.skip("yag-slam and evo are not installed: make environments")
    (tmp_path / "environments").symlink_to(OUT.resolve() / "environments")
    done = subprocess.run(
        [sys.executable, "-m", "experiments", "--short", "--out", str(tmp_path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    results = {result.case: result for result in read_csv(tmp_path / "tables/indoor_scans.csv")}
    slam, odometry = results[""], results["odometry alone"]
    assert slam.way_m > 4.0
    assert slam.poses > 30
    assert slam.ate_m < 0.03
    assert odometry.ate_m < 0.2
    for name in ("indoor_scans", "indoor_scans_map"):
        assert (tmp_path / "figures" / f"{name}.png").stat().st_size > 10_000
    assert "(figures/indoor_scans.png)" in (tmp_path / "experiments.md").read_text("utf-8")
