# SPDX-License-Identifier: Apache-2.0
"""Short runs of odometry with LiDARs of several patterns, on the road and in the room.

`make test-nightly` installs the programs before the tests.
"""

import subprocess
import sys
from pathlib import Path

import pytest

from experiments.estimation.environments import is_installed
from experiments.estimation.evaluation import read_csv
from experiments.estimation.programs import EVO, GENZ_LIO, KISS_ICP, RKO_LIO, SMALL_GICP
from experiments.experiment import OUT
from experiments.recording.setups import ROOT

pytest.importorskip("rclpy", reason="no ROS 2 here")
pytestmark = [pytest.mark.nightly, pytest.mark.timeout(900)]

PROGRAMS = (EVO, GENZ_LIO, KISS_ICP, RKO_LIO, SMALL_GICP)


@pytest.mark.parametrize(
    ("name", "runs", "checked", "share"),
    [("outdoor_defaults", 8, "OS1-64", 0.03), ("patterns", 10, "room", 0.03)],
)
def test_odometry_follows_a_short_drive(
    name: str, runs: int, checked: str, share: float, tmp_path: Path
) -> None:
    if not all(is_installed(program, OUT) for program in PROGRAMS):
        pytest.skip("programs are not installed: make environments")
    (tmp_path / "environments").symlink_to(OUT.resolve() / "environments")
    done = subprocess.run(
        [sys.executable, "-m", "experiments", name, "--short", "--out", str(tmp_path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    results = read_csv(tmp_path / "tables" / f"{name}.csv")
    assert len(results) == runs
    for result in results:
        assert result.poses > 100, result
        assert result.way_m > 3.0, result
        if checked in result.case:
            assert result.ate_m < share * result.way_m, result
