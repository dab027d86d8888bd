# SPDX-License-Identifier: Apache-2.0
"""System test of `groundlink up --sensors-together`: one process, separate status per sensor."""

import json
from pathlib import Path

import pytest

from .rig import children_of, rig, wait_for

pytestmark = pytest.mark.system

SENSORS = {"rover/lidar", "rover/imu", "rover/encoders"}


def test_sensors_of_a_shared_process_are_reported_separately(tmp_path: Path) -> None:
    report = tmp_path / "report.json"
    with rig(tmp_path, time_section="time: {mode: fast}\n") as it:
        up = it.up("--sensors-together", "--duration", "2", "--report", str(report))
        wait_for(lambda: len(children_of(up.pid)) == 4, 20, "all processes are there")
        (one,) = [line for line in children_of(up.pid).values() if "services.sensors" in line]
        assert "--name" not in one
        up.wait(60)  # what rates were kept is nothing to this test
    content = json.loads(report.read_text(encoding="utf-8"))
    processes = content["processes"]
    assert processes.keys() == {"physics", "gateway", "ros"} | SENSORS
    assert all(processes[name]["counters"]["readings"] > 10 for name in SENSORS)
    (mission,) = content["missions"]
    assert (mission["vehicle"], mission["state"], mission["failure"]) == ("rover", "standing", None)
    assert mission["seconds"] >= 2.0
