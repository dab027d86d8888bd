# SPDX-License-Identifier: Apache-2.0
"""System test: Groundlink passes the conformance kit of simulation_interfaces."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.ros.interfaces import simulation_interfaces

from .rig import REPOSITORY, rig, wait_for

pytest.importorskip("rclpy", reason="no ROS 2 here")
# Each day `test_ros_control.py` uses the services, and `tests/ros` tests the kit. The time is for
# compiling the messages, too.
pytestmark = [pytest.mark.system, pytest.mark.nightly, pytest.mark.timeout(240)]

KIT = REPOSITORY / "ros" / "simulation_interfaces_tck" / "src"
FEATURES = 31
"""Announced, of 32: time alone is not reset."""
CRATE = """\
name: crate
materials: {wood: {reflectivity: 0.5, friction: 0.5, color: [0.5, 0.4, 0.3]}}
solids: [{name: crate, shape: {kind: box, size_m: [0.3, 0.3, 0.3]}, material: wood}]
"""
# East of the rover, on the free lane of the room.
PLACES = ("--origin", "-3", "0", "0", "--spacing", "1.2")


def test_every_clause_of_announced_features_holds(
    tmp_path: Path, pytestconfig: pytest.Config
) -> None:
    interfaces = simulation_interfaces(pytestconfig.cache.mkdir("simulation_interfaces"))
    crate = tmp_path / "crate.yaml"
    crate.write_text(CRATE, encoding="utf-8")
    world = tmp_path / "lab.yaml"
    world.write_bytes((REPOSITORY / "scenarios" / "worlds" / "lab.yaml").read_bytes())
    with rig(tmp_path) as it:
        it.environment["PYTHONPATH"] = os.pathsep.join(map(str, (interfaces, KIT)))
        it.environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        physics = ("-m", "services.physics", str(it.scenario), "--listen", it.endpoint)
        it.start(*physics, "--only", "rover/imu", "--run", it.run, log="physics.log")
        wait_for(it.is_answered, 20, "physics listens")
        of_run = ("--run", it.run, "--connect", it.endpoint)
        it.start("-m", "services.gateway", *of_run, log="gateway.log")
        it.start("-m", "udp_bridge_ros2", "--bind", it.address(it.peer), log="node.log")
        kit = (sys.executable, "-m", "simulation_interfaces_tck", *PLACES)
        done = subprocess.run(
            [*kit, "--definition", str(crate), "--world", str(world), "--find-timeout", "30"],
            env=it.environment,
            capture_output=True,
            text=True,
            timeout=100,
            check=False,
        )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "NOT TESTED" not in done.stdout, done.stdout
    rows = [line for line in done.stdout.splitlines() if line.endswith("not announced")]
    assert len(rows) == 32 - FEATURES, done.stdout
