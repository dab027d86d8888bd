# SPDX-License-Identifier: Apache-2.0
"""System tests of single processes: each starts on its own, as on a separate machine."""

from pathlib import Path

import pytest

from .rig import Rig, rig, wait_for

pytestmark = pytest.mark.system

SENSORS = ("lidar", "imu", "encoders")


def start_separately(it: Rig) -> None:
    """Start every process by hand: physics is the router, the others know only its endpoint."""
    it.start("-m", "services.physics", str(it.scenario), "--listen", it.endpoint, log="physics.log")
    for name in SENSORS:
        start_sensor(it, name)


def start_sensor(it: Rig, name: str) -> int:
    wait_for(it.is_answered, 20, "physics listens")
    command = ("-m", f"services.sensors.{name}", "--name", f"rover/{name}")
    return it.start(*command, "--connect", it.endpoint, log=f"{name}.log").pid


def test_separate_processes_find_the_run_and_the_gateway_sends(
    tmp_path: Path,
) -> None:
    with rig(tmp_path) as it:
        start_separately(it)
        it.start("-m", "services.gateway", "--connect", it.endpoint, log="gateway.log")
        receiver = ("-m", "udp_bridge", "listen", "--bind", it.address(it.peer), "--json")
        it.start(*receiver, log="received.jsonl")
        for topic in ("/points", "/imu", "/wheel_encoders", "/clock", "/tf_static", "/cmd_vel"):
            wait_for(lambda t=topic: f'"{t}"' in it.log("received.jsonl"), 30, f"{topic} arrives")
