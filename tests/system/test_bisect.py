# SPDX-License-Identifier: Apache-2.0
"""Planted faults are found: a speed that a vehicle should not reach, and a commit of a stack."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from groundlink.__main__ import main as groundlink
from groundlink.bisection.search import most_probes
from tests.groundlink.cli.bisect.toys import ToyRepository
from tests.ros_domains import next_domain

from .rig import children_of, free_port, wait_for

pytestmark = [pytest.mark.system, pytest.mark.timeout(200)]

SCENARIO = """
name: toy
world: lab
vehicles:
  - name: rover
    model: rover
    placement: {x_m: -4.6, y_m: 0.0, yaw_deg: 0.0}
    sensors:
      - {kind: encoders, name: encoders, topic: /wheel_encoders, frame: base_link, rate_hz: 50.0}
"""
ROUTE = "    route: {kind: circle, laps: 3}\n"

TOP_SPEED = """
import sys
import groundlink

with groundlink.open(sys.argv[1]) as run:
    top_mps = run.array("/ground_truth/odom")["twist.twist.linear"][:, 0].max()
print(f"{top_mps:.3f} m/s")
sys.exit(0 if top_mps < 0.6 else 1)
"""

DRIVE = """
import sys
import groundlink
from controller import turn_radps

with groundlink.run("toy.yaml", record=sys.argv[1], sensors_together=True) as sim:
    for _ in range(10):
        sim.command("rover", 0.5, turn_radps(sim.latest("rover/ground_truth").position_m[1]))
        sim.step(0.1)
"""
CONTROLLER = "def turn_radps(y_m):\n    return {sign}2.0 * (y_m - 0.3)  # version {number}\n"

OFFSET = """
import sys
import groundlink

with groundlink.open(sys.argv[1]) as run:
    y_m = run.truth().positions_m[-1][1]
print(f"{y_m:.3f} m")
sys.exit(0 if y_m > 0 else 1)
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "driven.yaml").write_text(SCENARIO + ROUTE, encoding="utf-8")
    (tmp_path / "top_speed.py").write_text(TOP_SPEED, encoding="utf-8")
    (tmp_path / "offset.py").write_text(OFFSET, encoding="utf-8")
    return tmp_path


def test_bad_speed_is_found(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--set", "route.speed_mps=0.3,0.5,0.55,0.7", "--duration", "2", "--json"]
    check = ["--", sys.executable, "top_speed.py"]
    assert groundlink(["bisect", "driven.yaml", *words, *check]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["changes"] == [{"field": "route.speed_mps", "good": 0.55, "bad": 0.7}]
    assert result["first_difference"]["topic"] == "/cmd_vel"
    assert result["runs"] <= most_probes(4) == 4
    for name in ("good", "bad"):
        assert Path(result["recordings"][name]).stat().st_size > 10_000


def test_guilty_commit_is_found(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    toy = ToyRepository(folder / "stack")
    shas = []
    for number in range(5):
        controller = CONTROLLER.format(sign="-" if number < 3 else "", number=number)
        files = {"toy.yaml": SCENARIO, "drive.py": DRIVE, "controller.py": controller}
        shas.append(toy.commit(f"change {number}", files))
    words = ["--repository", "stack", "--good", shas[0], "--bad", "main", "--json"]
    program = ["--program", f"{sys.executable} drive.py"]
    check = ["--", sys.executable, "offset.py"]
    assert groundlink(["bisect", *words, *program, *check]) == 0
    result = json.loads(capsys.readouterr().out)
    assert [change["sha"] for change in result["changes"]] == [shas[3]]
    assert result["first_difference"]["topic"] == "/cmd_vel"
    assert result["first_difference"]["field"] == "angular.z"
    assert result["runs"] <= most_probes(5) == 4
    assert toy.git("status", "--porcelain") == ""


LOCKSTEP = """
time: {mode: fast, lockstep: ros, clock_rate_hz: 50, answers: {/cmd_vel: /wheel_encoders}}
gateway: {bind: "127.0.0.1:BIND", peer: "127.0.0.1:PEER"}
"""

NODE = """
import rclpy
from geometry_msgs.msg import Twist
from groundlink_msgs.msg import WheelEncoders

rclpy.init()
node = rclpy.create_node("driver")
publisher = node.create_publisher(Twist, "/cmd_vel", 10)

def answer(encoders):
    twist = Twist()
    twist.linear.x = float(open("speed").read())
    publisher.publish(twist)

node.create_subscription(WheelEncoders, "/wheel_encoders", answer, 10)
rclpy.spin(node)
"""


def test_ros_stack_of_a_commit_runs_in_lockstep(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("rclpy", reason="no ROS 2 here")
    monkeypatch.setenv("ROS_DOMAIN_ID", next_domain())
    ports = LOCKSTEP.replace("BIND", str(free_port())).replace("PEER", str(free_port()))
    (folder / "loop.yaml").write_text(SCENARIO + ports, encoding="utf-8")
    toy = ToyRepository(folder / "stack")
    shas = toy.commits([0.4, 0.8], {"node.py": NODE})
    words = ["loop.yaml", "--repository", "stack", "--good", shas[0], "--bad", shas[1], "--json"]
    stack = ["--stack", f"{sys.executable} node.py", "--duration", "1"]
    assert groundlink(["bisect", *words, *stack, "--", sys.executable, "top_speed.py"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert [change["sha"] for change in result["changes"]] == [shas[1]]
    difference = result["first_difference"]
    assert {name: difference[name] for name in ("topic", "sim_seconds", "number", "field")} == {
        "topic": "/cmd_vel",
        "sim_seconds": 0.0,
        "number": 1,
        "field": "linear.x",
    }
    assert (difference["good"], difference["bad"]) == ("0.4", "0.8")


def descendants(pid: int) -> set[int]:
    """Return the ids of all processes below a process."""
    children = children_of(pid)
    return {*children}.union(*map(descendants, children))


def test_ctrl_c_ends_all_processes_and_says_how_to_continue(folder: Path) -> None:
    words = ["bisect", "driven.yaml", "--set", "route.speed_mps=0.3,0.7", "--duration", "3600"]
    process = subprocess.Popen(
        [sys.executable, "-m", "groundlink", *words],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    )
    try:
        wait_for(lambda: len(descendants(process.pid)) > 4, 60, "a run has started")
        started = descendants(process.pid)
        process.send_signal(signal.SIGINT)  # not to its children
        printed, _ = process.communicate(timeout=30)
    finally:
        process.kill()
    assert process.returncode == 130
    assert "the same command continues" in printed
    wait_for(lambda: not any(Path(f"/proc/{pid}").exists() for pid in started), 30, "all ended")
