# SPDX-License-Identifier: Apache-2.0
"""Short live runs: odometry nodes of `examples` beside the bridge, outdoors and with a camera.

Sim time waits for the nodes. `make test-nightly` installs the programs before the tests.
"""

import subprocess
import sys
from pathlib import Path

import pytest

from experiments.estimation.environments import is_installed
from experiments.estimation.evaluation import read_csv
from experiments.estimation.programs import EVO, KISS_ICP
from experiments.experiment import OUT
from experiments.recording.setups import ROOT

pytest.importorskip("rclpy", reason="no ROS 2 here")
pytestmark = [pytest.mark.nightly, pytest.mark.timeout(300)]


@pytest.mark.parametrize("name", ["live_lidar", "live_camera"])
def test_a_node_estimates_the_path_beside_the_run(name: str, tmp_path: Path) -> None:
    if not all(is_installed(program, OUT) for program in (KISS_ICP, EVO)):
        pytest.skip("kiss-icp and evo are not installed: make environments")
    (tmp_path / "environments").symlink_to(OUT.resolve() / "environments")
    done = subprocess.run(
        [sys.executable, "-m", "experiments", name, "--short", "--out", str(tmp_path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    (result,) = read_csv(tmp_path / "tables" / f"{name}.csv")
    assert result.poses > 30
    assert result.way_m > 1.0
    assert result.ate_m < 0.01 * result.way_m
    assert (tmp_path / "figures" / f"{name}.png").stat().st_size > 10_000
