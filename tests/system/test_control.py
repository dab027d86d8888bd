# SPDX-License-Identifier: Apache-2.0
"""System tests of run control: pause, step and reset with real processes and a real bus."""

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from groundlink.bus.control_client import run_status, send_command
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.bus.topics import SENSOR_TOPICS
from groundlink.episode.control import Pause, Reset, Resume, Step
from groundlink.messages.base import Imu, encode

from .rig import Rig, rig, wait_for

pytestmark = pytest.mark.system

SAMPLES = 400


@pytest.fixture(params=["fast", "realtime"])
def run(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[Rig, Bus, BusInbox[Imu]]]:
    with rig(tmp_path, time_section=f"time: {{mode: {request.param}, epoch: zero}}\n") as it:
        physics = ("-m", "services.physics", str(it.scenario), "--listen", it.endpoint)
        # It begins when the sensor is there, also in real time.
        alone = ("--only", "rover/imu", "--wait-for", "rover/imu", "--run", it.run)
        it.start(*physics, *alone, log="physics.log")
        wait_for(it.is_answered, 20, "physics listens")
        with Bus(connect=it.endpoint) as bus:
            samples: BusInbox[Imu] = BusInbox(depth=100_000)
            bus.subscribe(
                SENSOR_TOPICS["imu"].key_in(it.run, vehicle="rover", sensor="imu"), Imu, samples
            )
            sensor = ("-m", "services.sensors.imu", "--name", "rover/imu", "--run", it.run)
            it.start(*sensor, "--connect", it.endpoint, log="imu.log")
            yield it, bus, samples


def first_samples(samples: BusInbox[Imu]) -> list[bytes]:
    """Return what comes from the first sample of an episode on."""
    first = 0
    found: list[bytes] = []
    while len(found) < SAMPLES:
        arrived = samples.get(seconds=30)
        assert arrived, "the sensor fell silent"
        if not found or arrived[1].stamp_nanos < first:
            first, found = arrived[1].stamp_nanos, []
        found.append(encode(arrived[1]))
    return found


def test_time_stands_still_goes_on_by_ticks_and_begins_again(
    run: tuple[Rig, Bus, BusInbox[Imu]],
) -> None:
    it, bus, samples = run
    first_episode = first_samples(samples)

    paused = send_command(bus, it.run, Pause())
    assert paused.paused
    send_command(bus, it.run, Step(5))
    wait_for(lambda: run_status(bus, it.run).paused, 20, "five steps are taken")
    assert run_status(bus, it.run).tick == paused.tick + 5

    while samples.get(seconds=0.3):
        pass  # what is left of the first episode
    again = send_command(bus, it.run, Reset())
    assert again.paused
    assert again.tick == 0
    assert not send_command(bus, it.run, Resume()).paused
    assert first_samples(samples) == first_episode


def test_command_line_prints_the_result(run: tuple[Rig, Bus, BusInbox[Imu]]) -> None:
    it, _, samples = run
    first_samples(samples)
    command = [sys.executable, "-m", "groundlink", "step", "7", "--connect", it.endpoint]
    done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith(f"run `{it.run}` is paused at tick ")
    done = subprocess.run([*command, "--json"], capture_output=True, text=True, timeout=30)
    status = json.loads(done.stdout)
    assert (status["run"], status["paused"]) == (it.run, True)
    assert status["tick"] > 0
    command[4] = "0"
    done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=False)
    assert (done.returncode, done.stderr) == (
        2,
        "groundlink: step: expected 1 or more ticks, got 0\n",
    )
