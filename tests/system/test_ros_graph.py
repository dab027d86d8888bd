# SPDX-License-Identifier: Apache-2.0
"""System tests of a graph of five ROS nodes in lockstep: equal messages, or the node to blame."""

import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

from benchmarks.freshness.two_hosts import NotAllowed
from benchmarks.ros_graph.runs import SCENARIO, TRACE, run_stack
from groundlink.core.clock import TICK_SECONDS
from groundlink.recording.traces import TracedMessage, compare_traces, read_trace
from tests.ros_domains import next_domain

from .rig import REPOSITORY, free_port

pytest.importorskip("rclpy", reason="no ROS 2 here")
pytestmark = pytest.mark.system

SECONDS = 0.6


def trace(folder: Path, threads: int) -> Mapping[str, Sequence[TracedMessage]]:
    run_stack(folder, seconds=SECONDS, threads=threads)
    return read_trace(folder / TRACE, round(SECONDS / TICK_SECONDS))


def test_three_processes_on_another_host_with_loss_and_delays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", next_domain())
    try:
        first, second = (trace(tmp_path / str(threads), threads) for threads in (3, 1))
    except NotAllowed as error:
        pytest.skip(f"no network of its own: {error}")
    rows = compare_traces(first, second, {})
    assert [row for row in rows if row.difference] == []
    assert len(rows) == 12
    assert len(first["/target"]) == len(first["/estimate"]) + len(first["/obstacle"]) > 30
    assert len(first["/status"]) == len(first["/cmd_vel"]) // 5


def test_verify_names_the_node_that_publishes_by_the_wall_clock(tmp_path: Path) -> None:
    file = tmp_path / "stack.yaml"
    bind, peer = (f"127.0.0.1:{free_port()}" for _ in range(2))
    gateway = f"gateway: {{bind: {bind}, peer: {peer}}}\n"
    file.write_text(SCENARIO.read_text(encoding="utf-8") + gateway, encoding="utf-8")
    nodes = ("estimator,detector,timer,controller,watchdog", "1", "0")
    done = subprocess.run(
        [
            *(sys.executable, "-m", "groundlink", "verify", "--json", "--duration", "0.1"),
            *("--ros", str(file), "--", sys.executable, "-m", "benchmarks.ros_graph.nodes", *nodes),
        ],
        cwd=REPOSITORY,
        env=os.environ | {"ROS_DOMAIN_ID": next_domain()},
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert done.returncode == 1, done.stderr
    found = json.loads(done.stdout)
    assert not found["identical"]
    worst = found["topics"][0]
    assert (worst["topic"], worst["node"]) == ("/target", "planner")
    assert worst["difference"]["stamp_nanos"] is not None
