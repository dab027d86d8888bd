# SPDX-License-Identifier: Apache-2.0
"""Recordings of a run on the ROS side: bus, gateway, UDP Bridge, ROS node, recording node.

A recording is made once; its folder name holds a digest of everything it depends on. The bus is
recorded as well, so messages missing or changed in the bag are counted.
"""

import json
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import IO

import groundlink
from experiments.output.console import Console
from groundlink.core.errors import UserError
from groundlink.data.trajectory import Trajectory, read_tum, write_tum
from groundlink.monitor.process_commands import free_endpoint
from groundlink.monitor.supervisor import end_with_parent
from groundlink.scenario import Scenario
from udp_bridge_ros2.environment import apply_defaults

from .deliveries import (
    TopicDelivery,
    compare_delivery,
    loss_summary,
    read_deliveries,
    write_deliveries,
)
from .setups import ROOT, Setup, loaded

END_S = 20.0
"""Timeout for processes to end."""

SILENT_S = 180.0
"""Timeout for a run whose clock does not advance."""


@dataclass(frozen=True)
class RecordedRun:
    """Folder of a recorded run: bag, ground truth, and delivery of each topic."""

    folder: Path

    @property
    def bag(self) -> Path:
        """The bag as the ROS side wrote it."""
        return self.folder / "run.mcap"

    @cached_property
    def scenario(self) -> Scenario:
        """The scenario, resolved; an outdoor one takes half a second."""
        return loaded(self.folder)

    @property
    def seed(self) -> int:
        """The run's seed."""
        return self.scenario.seed

    @property
    def deliveries(self) -> list[TopicDelivery]:
        """Delivery of each topic."""
        return read_deliveries(self.folder / "deliveries.csv")

    def truth(self, frame: str = "") -> Trajectory:
        """Return world_from_frame over the run; of the vehicle's base if no frame is named."""
        base = read_tum(self.folder / "truth.tum")
        if not frame:
            return base
        frames = json.loads((self.folder / "frames.json").read_text(encoding="utf-8"))
        return base.seen_from(frames[frame])


def record(setup: Setup, out: Path, console: Console) -> RecordedRun:
    """Return the recording of a setup, made if there is none for the current sources.

    Raises
    ------
    UserError
        when the run fails, or a lockstep run lost messages.
    """
    folder = out / "recordings"
    folder.mkdir(parents=True, exist_ok=True)
    made = folder / f"{setup.name}-{setup.seed}-{setup.digest()}"
    if (made / "deliveries.csv").exists():
        return RecordedRun(made)
    part = made.with_name(f"{made.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir()
    _run(setup, part, console)
    console.print(f"{setup.name}, seed {setup.seed}: comparing the bag with the bus")
    bus, bag = part / "bus.mcap", part / "run.mcap"
    deliveries = compare_delivery(bus, bag, loaded(part))
    if setup.is_lossless and (words := loss_summary(deliveries)):
        raise UserError(f"{setup.name}, seed {setup.seed}: not all came to {bag}: {words}")
    with groundlink.open(bus) as dataset:
        write_tum(part / "truth.tum", dataset.truth())
        mounts = {
            frame: dataset.mount(vehicle, frame)
            for vehicle, frames in dataset.frames.items()
            for frame in frames
        }
    (part / "frames.json").write_text(json.dumps(mounts), encoding="utf-8")
    write_deliveries(part / "deliveries.csv", deliveries)
    bus.unlink()
    part.rename(made)
    return RecordedRun(made)


def _run(setup: Setup, folder: Path, console: Console) -> None:
    """Start all processes, wait for the end of the bag, and stop all."""
    scenario = setup.write(folder, gateway_addresses())
    run = f"experiment_{os.getpid()}_{random.randrange(10**6)}"
    up = ["-m", "groundlink", "up", str(scenario), "--run", run, "--listen", free_endpoint()]
    if setup.time.get("mode") != "realtime":  # sensors may wait for each other: it is less work
        up.append("--sensors-together")
    bag = ("-m", "experiments.recording.ros_bag", str(folder / "run.mcap"), str(setup.seconds))
    environment = ros_environment()
    with (
        process(bag, folder / "bag.log", environment) as recorder,
        process(
            (*up, "--record", str(folder / "bus.mcap")), folder / "up.log", environment
        ) as supervisor,
    ):
        _wait(setup, recorder, supervisor, folder, console)


def _wait(
    setup: Setup,
    recorder: subprocess.Popen[str],
    supervisor: subprocess.Popen[str],
    folder: Path,
    console: Console,
) -> None:
    begun_s = moved_s = time.monotonic()
    seconds = -1.0
    while recorder.poll() is None:
        now_s = time.monotonic()
        told = last_json(folder / "bag.log")
        if told.get("seconds", 0.0) > seconds:
            seconds, moved_s = told.get("seconds", 0.0), now_s
        console.progress(
            f"{setup.name}, seed {setup.seed}: recording, {max(seconds, 0.0):.0f} of "
            f"{setup.seconds:g} s, {told.get('messages', 0):.0f} messages, {now_s - begun_s:.0f} s"
        )
        if supervisor.poll() is not None or now_s - moved_s > SILENT_S:
            why = "has ended" if supervisor.poll() is not None else f"stood for {SILENT_S:g} s"
            last = (folder / "up.log").read_text(encoding="utf-8").strip().splitlines()[-5:]
            raise UserError(
                f"{setup.name}, seed {setup.seed}: the run {why} at {max(seconds, 0.0):.1f} s; "
                f"{folder / 'up.log'} says:\n" + "\n".join(last)
            )
        time.sleep(0.2)
    if recorder.returncode:
        raise UserError(f"{setup.name}: the recording node has failed; see {folder / 'bag.log'}")
    console.print(
        f"{setup.name}, seed {setup.seed}: recorded {setup.seconds:g} s in "
        f"{time.monotonic() - begun_s:.0f} s"
    )


def gateway_addresses() -> dict[str, str]:
    """Return free addresses of a gateway and of its peer, as `gateway` of a scenario has them."""
    return {name: f"127.0.0.1:{free_port()}" for name in ("bind", "peer")}


def ros_environment() -> dict[str, str]:
    """Return environment variables for ROS 2 nodes of one run, in a DDS domain of their own."""
    environment = {"ROS_DOMAIN_ID": str(random.randrange(1, 100))}
    apply_defaults(environment)
    return environment


def last_json(log: Path) -> dict[str, float]:
    """Return the last JSON line of a log, or an empty dict."""
    lines = log.read_text(encoding="utf-8").splitlines()
    for line in reversed(lines):
        if line.startswith("{"):
            try:
                told: dict[str, float] = json.loads(line)
                return told
            except json.JSONDecodeError:  # it is being written
                continue
    return {}


@contextmanager
def process(
    command: Sequence[str],
    log: Path,
    environment: dict[str, str],
    python: str = sys.executable,
) -> Iterator[subprocess.Popen[str]]:
    """Run a Python process with its output in a file; end it on exit."""
    output: IO[str]
    with log.open("w", encoding="utf-8") as output:
        process = subprocess.Popen(
            [python, *command],
            cwd=ROOT,
            env=os.environ | environment | {"PYTHONUNBUFFERED": "1"},
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            text=True,
            preexec_fn=end_with_parent,
        )
    try:
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        try:
            process.wait(END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def free_port() -> int:
    """Return a free UDP port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
