# SPDX-License-Identifier: Apache-2.0
"""System test of spawning: the scanner sees a box while it exists; runs have identical bytes."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from groundlink.bus.control_client import run_status, send_command
from groundlink.bus.inbox import BusInbox
from groundlink.bus.queries import control_key
from groundlink.bus.session import Bus
from groundlink.bus.topics import SENSOR_TOPICS
from groundlink.core.errors import UserError
from groundlink.episode.control import Pause, Step
from groundlink.messages.base import PointCloud, encode

from .rig import Rig, rig, wait_for

pytestmark = pytest.mark.system

TICKS = 200
TIME = "time: {mode: fast, epoch: zero}\n"


def command(it: Rig, *words: str) -> subprocess.CompletedProcess[str]:
    line = [sys.executable, "-m", "groundlink", *words, "--connect", it.endpoint]
    return subprocess.run(line, capture_output=True, text=True, timeout=60, check=False)


def step_to(it: Rig, bus: Bus, tick: int) -> None:
    send_command(bus, it.run, Step(TICKS))
    wait_for(lambda: run_status(bus, it.run).tick == tick, 60, f"tick {tick} is stepped to")


def clouds(folder: Path) -> Iterator[PointCloud]:
    """Yield the revolutions of a run in which a box stands ahead for half a second."""
    with rig(folder, time_section=TIME) as it:
        physics = ("-m", "services.physics", str(it.scenario), "--listen", it.endpoint)
        it.start(*physics, "--only", "rover/lidar", "--run", it.run, log="physics.log")
        wait_for(it.is_answered, 20, "physics listens")
        with Bus(connect=it.endpoint) as bus:
            got: BusInbox[PointCloud] = BusInbox(depth=1000)
            key = SENSOR_TOPICS["lidar"].key_in(it.run, vehicle="rover", sensor="lidar")
            bus.subscribe(key, PointCloud, got)
            wait_for(
                lambda: bool(bus.query(control_key(it.run), seconds=1)), 20, "physics is there"
            )
            send_command(bus, it.run, Pause())
            sensor = ("-m", "services.sensors.lidar", "--name", "rover/lidar", "--run", it.run)
            it.start(*sensor, "--connect", it.endpoint, log="lidar.log")
            step_to(it, bus, 1 * TICKS)
            done = command(it, "spawn", "box", "--at=-3.0,0")
            assert (done.returncode, done.stderr) == (0, "")
            assert done.stdout == f"run `{it.run}`: added `box` at tick 201 (0.5025 s)\n"
            again = command(it, "spawn", "crate", "--at=-3.0,0")
            assert again.returncode == 2
            assert again.stderr == (
                f"groundlink: run `{it.run}`: `crate` would be inside `box`. Fix: choose another "
                "place\n"
            )
            step_to(it, bus, 2 * TICKS)
            done = command(it, "remove", "box")
            assert (done.returncode, done.stderr) == (0, "")
            with pytest.raises(UserError, match="no vehicle or object `box`"):
                raise UserError(command(it, "remove", "box").stderr)
            step_to(it, bus, 3 * TICKS)
            last_nanos = 1_400_000_000
            newest = -1
            while newest < last_nanos:
                arrived = got.get(seconds=30)
                assert arrived, "the scanner fell silent"
                newest = arrived[1].stamp_nanos
                yield arrived[1]


def box_seen(cloud: PointCloud) -> bool:
    """Tell whether there is something in the free lane, less than 2 m ahead."""
    points = cloud.records()
    ahead = (points["x"] > 0.5) & (points["x"] < 2.0) & (np.abs(points["y"]) < 0.2)
    return bool((ahead & (points["z"] > -0.6)).any())


def test_a_box_is_seen_while_it_is_there_and_runs_repeat(tmp_path: Path) -> None:
    runs = []
    for name in ("first", "second"):
        folder = tmp_path / name
        folder.mkdir()
        runs.append(list(clouds(folder)))
    seen = {round(cloud.stamp_nanos * 1e-9, 2): box_seen(cloud) for cloud in runs[0]}
    # The revolution that is under way when the world changes is lost.
    assert seen == {t: 0.5 < t < 1.0 for t in seen}
    assert len(seen) >= 11
    assert list(map(encode, runs[0])) == list(map(encode, runs[1]))
