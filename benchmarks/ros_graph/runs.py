# SPDX-License-Identifier: Apache-2.0
"""A run on one emulated host, and the ROS 2 node with a stack in three processes on another."""

import json
import os
import subprocess
import sys
from pathlib import Path

from benchmarks.freshness.two_hosts import HOSTS, run
from groundlink.emulation.settings import Impairment
from groundlink.monitor.supervisor import end_with_parent

REPOSITORY = Path(__file__).parents[2]
SCENARIO = Path(__file__).with_name("stack.yaml")
PORTS = 7510, 7511
MTU = 1500
LIMIT_SECONDS = 100.0

TRACE, REPORT, LOG = "trace", "report.json", "log"
"""Files of a run."""
TARGETS_PER_SECOND = 60
"""One for each estimate and each scan, in sim time."""
TIMED_TARGETS = TARGETS_PER_SECOND, 5 * TARGETS_PER_SECOND
"""Numbers of the targets whose wall time the controller logs."""
TIMED = "controller: wall time at a target:"
"""Words before a wall time in the log."""


def processes(planner: str = "planner") -> tuple[str, ...]:
    """Return the nodes of each process of the stack; see `nodes`."""
    return "estimator,detector", planner, "controller,watchdog"


def run_stack(
    folder: Path,
    *,
    seconds: float,
    loss: float = 0.05,
    longest_delay_s: float = 0.01,
    threads: int = 3,
    planner: str = "planner",
    settings: tuple[str, ...] = (),
) -> float:
    """Run the stack; return sim seconds for each wall second.

    Parameters
    ----------
    folder
        a new folder for the files of the run.
    seconds
        sim time.
    loss
        probability that the network between the hosts loses a packet, each way.
    longest_delay_s
        random delay of a node, in wall time.
    threads
        of each executor. With several, rclpy 9.1 takes about 0.1 s for a message, mostly idle.
    planner
        name of the planner; `timer` breaks the rule of lockstep.
    settings
        `FIELD=VALUE` for fields of the scenario.

    Raises
    ------
    NotAllowed
        when this process may not make networks.
    RuntimeError
        when the run did not end in time.
    """
    folder.mkdir()
    gateway, node = (f"{host}:{port}" for host, port in zip(reversed(HOSTS), PORTS, strict=True))
    settings = (
        *(f"gateway.bind={gateway}", f"gateway.peer={node}", "gateway.datagram=mtu"),
        *settings,
    )

    def ros() -> None:
        _log_to(folder)
        trace = str(folder / TRACE)
        bridge = ("udp_bridge_ros2", "--bind", node, "--peer", gateway, "--trace", trace)
        nodes = ("benchmarks.ros_graph.nodes",)
        started = [
            subprocess.Popen([sys.executable, "-m", *words], preexec_fn=end_with_parent)
            for words in (
                bridge,
                *(
                    (*nodes, names, str(threads), str(longest_delay_s))
                    for names in processes(planner)
                ),
            )
        ]
        for process in started:
            process.wait()

    def simulator() -> None:
        _log_to(folder)
        words = ["up", str(SCENARIO), "--no-ros", "--sensors-together", "--run", "stack"]
        words += ["--duration", str(seconds), "--report", str(folder / REPORT)]
        words += [word for setting in settings for word in ("--set", setting)]
        os.execv(sys.executable, [sys.executable, "-m", "groundlink", *words])

    run((ros, simulator), Impairment(loss=loss), mtu=MTU, seconds=LIMIT_SECONDS)
    if not (folder / REPORT).exists():
        raise RuntimeError(f"the run did not end; its log:\n{(folder / LOG).read_text()}")
    return float(json.loads((folder / REPORT).read_bytes())["real_time_factor"])


def steady_pace(folder: Path) -> float:
    """Return sim seconds for each wall second of a run, without its start, which takes seconds.

    Raises
    ------
    ValueError
        when the run was too short.
    """
    words = [line.split(TIMED) for line in (folder / LOG).read_text().splitlines()]
    begun_s, ended_s = (float(found[1]) for found in words if len(found) == 2)
    first, last = TIMED_TARGETS
    return (last - first) / TARGETS_PER_SECOND / (ended_s - begun_s)


def _log_to(folder: Path) -> None:
    """Write the output of this process and its children to a file."""
    os.chdir(REPOSITORY)
    log = os.open(folder / LOG, os.O_CREAT | os.O_WRONLY | os.O_APPEND)
    for stream in (1, 2):
        os.dup2(log, stream)
