# SPDX-License-Identifier: Apache-2.0
"""Runs with an odometry node beside them: its poses return through the bridge."""

import json
import os
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import groundlink
from experiments.output.console import Console
from groundlink.core.errors import UserError
from groundlink.data.trajectory import write_tum
from groundlink.monitor.process_commands import free_endpoint

from .recordings import RecordedRun, gateway_addresses, process, ros_environment
from .setups import CLOCK_HZ, IN_REAL_TIME, ROOT, Setup

LOOK_S = 0.2
MISSED_SHARE = 0.02
"""Largest accepted share of messages without a pose, once the first pose was there."""


@dataclass(frozen=True, kw_only=True)
class LiveNode:
    """A ROS 2 node of `examples` that publishes an odometry message for each message of a topic.

    It runs in Groundlink's environment, which has ROS 2.
    """

    script: str
    """Below `examples`."""

    takes: str
    odometry: str
    rate_hz: float
    """Of the topic that it takes."""

    frame: str
    """Frame whose poses it estimates."""

    parameters: tuple[str, ...] = ()
    """Such as `lowest_m:=-1.0`."""

    def beside(self, setup: Setup, *, waits: bool) -> Setup:
        """Return a setup whose run has the node's odometry on the bus.

        Parameters
        ----------
        waits
            sim time waits for the node; otherwise the run is in real time.
        """
        time: dict[str, Any] = dict(IN_REAL_TIME)
        if waits:
            time = {"mode": "fast", "lockstep": "ros", "epoch": "zero", "clock_rate_hz": CLOCK_HZ}
            time["answers"] = {self.odometry: self.takes}
        vehicle = {**setup.vehicle, "from_ros": {"odometry": self.odometry}}
        return replace(setup, time=time, vehicle=vehicle)


def record_beside(
    setup: Setup, node: LiveNode, folder: Path, console: Console, packages: Path | None = None
) -> tuple[RecordedRun, Path]:
    """Record a run and a node beside it; return the run and the TUM file of the node's poses.

    Parameters
    ----------
    setup
        from `LiveNode.beside`.
    packages
        folder of packages that the node imports besides.

    Raises
    ------
    UserError
        when the run fails, or the node does not keep up.
    """
    scenario, bus_file = setup.write(folder, gateway_addresses()), folder / "bus.mcap"
    bus_file.unlink(missing_ok=True)
    environment = ros_environment()
    beside = environment | ({"PYTHONPATH": str(packages)} if packages else {})
    script = [str(ROOT / "examples" / node.script), "--ros-args"]
    script += [word for parameter in node.parameters for word in ("-p", parameter)]
    up = ["-m", "groundlink", "up", str(scenario), "--listen", free_endpoint()]
    up += ["--run", f"live_{os.getpid()}", "--record", str(bus_file)]
    up += ["--duration", str(setup.seconds)]
    label = f"{setup.name}, seed {setup.seed}"
    with (
        process(script, folder / "node.log", beside) as odometry,
        process(up, folder / "up.log", environment) as supervisor,
    ):
        while supervisor.poll() is None:
            console.progress(f"{label}: {node.script} beside a run of {setup.seconds:g} s")
            if odometry.poll() is not None:
                raise UserError(f"{label}: the node ended early; see {folder / 'node.log'}")
            time.sleep(LOOK_S)
    if supervisor.returncode:
        raise UserError(f"{label}: the run failed; see {folder / 'up.log'}")
    estimate = folder / "estimate.tum"
    with groundlink.open(bus_file) as dataset:
        truth, poses = dataset.truth(), dataset.poses(node.odometry)
        vehicle = dataset.scenario.vehicles[0].name
        mount = dataset.mount(vehicle, node.frame)
    # The truth ends with the recording; the last poses may be stamped after it.
    poses = poses.between(truth.seconds[0], truth.seconds[-1])
    write_tum(folder / "truth.tum", truth)
    write_tum(estimate, poses)
    (folder / "frames.json").write_text(json.dumps({node.frame: mount}), encoding="utf-8")
    due = round((poses.seconds[-1] - poses.seconds[0]) * node.rate_hz) + 1
    missed = due - len(poses.seconds)
    console.print(f"{label}: {len(poses.seconds)} of {due} poses returned to the bus")
    if missed > MISSED_SHARE * due:
        raise UserError(f"{label}: the node did not keep up; see {folder}")
    return RecordedRun(folder), estimate


def packages_of(python: Path) -> Path:
    """Return the folder of packages of an environment with this Python's version."""
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    return python.parents[1] / "lib" / version / "site-packages"
