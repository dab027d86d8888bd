# SPDX-License-Identifier: Apache-2.0
"""A run that is put at an instant of a recorded one goes on as that did, to the byte."""

import json
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import pytest

from groundlink.bus.control_client import run_status, send_command
from groundlink.bus.queries import control_key
from groundlink.bus.session import Bus
from groundlink.core.clock import NANOS, TICK_SECONDS
from groundlink.episode.control import Resume
from groundlink.recording.reader import Recording
from groundlink.ros.diagnostics import DIAGNOSTICS_TOPIC

from .rig import REPOSITORY, Rig, rig, wait_for

pytestmark = [pytest.mark.system, pytest.mark.timeout(300)]

RECORDED_S, COMPARED_S = 8.0, 1.5
INSTANTS = (5.2, 2.3, 0.4)
"""Between checkpoints; after one, before all can continue from it; before the first one."""

JOIN_S = 0.02
"""A recorder that starts with a run may miss the driver's command at the state where it stands."""

SCENARIOS = {
    "rover": """
name: seek_rover
seed: 1
world: worlds/yard.yaml
vehicles:
  - name: rover
    model: vehicles/rover.yaml
    placement: {x_m: -8.0, y_m: -4.0}
    sensors:
      - {kind: gnss, datasheet: sensors/gnss_rtk_fix.yaml, name: gnss, topic: /fix, frame: gnss}
      - {kind: imu, datasheet: sensors/imu_mti1.yaml, name: imu, topic: /imu, frame: imu}
      - {kind: encoders, name: encoders, topic: /ticks, frame: base_link, rate_hz: 50.0}
      - {kind: wheel_odometry, name: odometry, encoders: encoders, topic: /odom, frame: odom}
    route: {kind: circle, radius_m: 3.0, speed_mps: 0.8}
""",
    "tank": """
name: seek_tank
seed: 1
world: worlds/rural.yaml
vehicles:
  - name: tank
    model: vehicles/tank.yaml
    placement: {x_m: 0.0, y_m: -46.5, yaw_deg: 4.0}
    sensors:
      - {kind: imu, datasheet: sensors/imu_mti1.yaml, name: imu, topic: /imu, frame: imu}
    route: {kind: circle, radius_m: 8.0, speed_mps: 2.0}
""",
}
"""Without heavy sensors: what they measure follows from the states."""

Messages = dict[str, list[tuple[int, bytes]]]


def groundlink(it: Rig, *words: str | Path) -> str:
    """Return what a command of the run prints; of two lines for people, the result."""
    command = [sys.executable, "-m", "groundlink", *map(str, words), "--run", it.run]
    done = subprocess.run(
        command, cwd=REPOSITORY, env=it.environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def messages(file: Path, begin_s: float) -> Messages:
    """Return all that was recorded after an instant, for as long as is compared."""
    found: Messages = defaultdict(list)
    with Recording(file) as recording:
        epoch_nanos = recording.run.epoch_nanos
        begin, end = (epoch_nanos + round(s * NANOS) for s in (begin_s, begin_s + COMPARED_S))
        for message in recording.read(from_nanos=begin):
            if begin < message.nanos < end and message.topic != DIAGNOSTICS_TOPIC:
                found[message.topic].append((message.nanos, message.cdr))
    return found


def tick_of(seconds: float) -> int:
    return round(seconds / TICK_SECONDS)


def go_on(it: Rig, bus: Bus, seconds: float) -> None:
    """Let a run go on until what is compared is recorded."""
    send_command(bus, it.run, Resume())
    until = tick_of(seconds + COMPARED_S + 1.0)
    wait_for(lambda: run_status(bus, it.run).tick > until, 60, "the run goes on")


@pytest.mark.parametrize("name", ["rover", pytest.param("tank", marks=pytest.mark.nightly)])
def test_goes_on_as_recorded(name: str, tmp_path: Path) -> None:
    scenario, run = tmp_path / f"{name}.yaml", tmp_path / "run.mcap"
    with rig(tmp_path) as it:
        ports = f"gateway: {{bind: {it.address(it.bind)}, peer: {it.address(it.peer)}}}\n"
        scenario.write_text(SCENARIOS[name] + ports, encoding="utf-8")
        listen = ("--listen", it.endpoint)
        record = ("record", scenario, "--duration", str(RECORDED_S), "--checkpoints", "2")
        groundlink(it, *record, "--out", run, *listen)
        first, *later = INSTANTS
        again = tmp_path / "again.mcap"
        it.start(
            *("-m", "groundlink", "up", str(run), "--at", str(first), "--no-ros"),
            *("--record", str(again), "--run", it.run, *listen),
            log="up.log",
        )
        wait_for(it.is_answered, 60, "the router listens")
        with Bus(connect=it.endpoint) as bus:
            wait_for(lambda: is_at(bus, it.run, first), 60, "the run stands at the instant")
            go_on(it, bus, first)
            for seconds in later:
                words = ("seek", run, "--at", str(seconds), "--json", "--connect", it.endpoint)
                state = json.loads(groundlink(it, *words))
                assert (state["tick"], state["paused"]) == (tick_of(seconds), True)
                go_on(it, bus, seconds)
        it.stop()
        files = (again, *(tmp_path / f"again_{i}.mcap" for i in (2, 3)))
        begins = (first + JOIN_S, *later)
        for begin_s, file in zip(begins, files, strict=True):
            expected = messages(run, begin_s)
            assert len(expected["/imu"]) > 400 * COMPARED_S - 2
            assert expected == messages(file, begin_s)
        verify = [sys.executable, "-m", "groundlink", "verify", str(run), str(scenario)]
        done = subprocess.run(verify, cwd=REPOSITORY, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr


def is_at(bus: Bus, run: str, seconds: float) -> bool:
    """Return whether a run stands at an instant, with all of its processes."""
    if not bus.query(control_key(run), seconds=1):
        return False
    status = run_status(bus, run)
    return status.paused and status.restoring_to < 0 and status.tick == tick_of(seconds)
