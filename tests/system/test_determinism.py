# SPDX-License-Identifier: Apache-2.0
"""System tests of determinism: in lockstep every sensor publishes the same bytes.

The bytes must not depend on the host, the start time or the speed of a process. The reference is an
undisturbed run of 5 s in fast mode with every kind of sensor, all in one process. Two runs follow
the wall clock; they start together with the reference run and end after their checks.
"""

import os
import random
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import msgspec
import pytest

from benchmarks.freshness.two_hosts import HOSTS, NotAllowed
from benchmarks.freshness.two_hosts import run as run_on_two_hosts
from groundlink.bus.control_client import send_command
from groundlink.core.clock import TICK_NANOS
from groundlink.emulation.settings import Impairment
from groundlink.episode import journal
from groundlink.episode.control import Pause, Resume

from .determined import HEARD, RUN, SECONDS, UNTIL_NANOS, Heard, Run, difference, run
from .rig import REPOSITORY, is_answered, wait_for

pytestmark = [pytest.mark.system, pytest.mark.timeout(300)]


def together(it: Run) -> None:
    """Start the run with all sensors in one process."""
    it.start("physics", "rover/driver")
    it.start_module("sensors", "services.sensors")


def apart(it: Run) -> None:
    """Start the run with each sensor in a process of its own."""
    it.start(*it.names)


FACTORS = {1.0: apart, 0.5: together}
"""Runs at the wall clock's pace."""


class Saved(NamedTuple):
    """A run that was saved at about half time."""

    file: Path
    before: Heard
    """What the run had published when it went on."""


@pytest.fixture(scope="module")
def paced(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[float, Run]]:
    with ExitStack() as opened:
        runs = {}
        for factor, start in FACTORS.items():
            folder = tmp_path_factory.mktemp("paced")
            it = opened.enter_context(run(folder, f"mode: lockstep, factor: {factor}"))
            start(it)
            runs[factor] = it
        yield runs


@pytest.fixture(scope="module")
def undisturbed(paced: dict[float, Run], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Run]:
    with run(tmp_path_factory.mktemp("undisturbed")) as it:
        together(it)
        yield it


@pytest.fixture(scope="module")
def saved(paced: dict[float, Run], undisturbed: Run) -> Saved:
    """Pause and save the run at the wall clock's pace while the undisturbed run goes on."""
    it = paced[1.0]
    file = it.rig.folder / "half_time.run"
    it.witness.wait(UNTIL_NANOS // 2)
    send_command(it.bus, RUN, Pause())
    join = ("--connect", it.rig.endpoint, "--run", RUN)
    saving = it.rig.start("-m", "groundlink", "save", str(file), *join, log="save.log")
    assert saving.wait(60) == 0, it.rig.log("save.log")
    tick = journal.loaded(journal.read(file), str(file)).tick
    assert tick * TICK_NANOS < 0.75 * UNTIL_NANOS
    send_command(it.bus, RUN, Resume())
    it.witness.wait(tick * TICK_NANOS)
    return Saved(file, it.witness.so_far())


@pytest.fixture(scope="module")
def expected(undisturbed: Run, saved: Saved) -> Heard:
    heard = undisturbed.witness.heard()
    undisturbed.rig.stop()
    return heard


def test_every_stream_is_complete(expected: Heard) -> None:
    counts = {key.removeprefix(f"groundlink/{RUN}/rover/"): len(b) for key, b in expected.items()}
    assert 6 * SECONDS < counts.pop("lidar") < 10 * SECONDS, "a fault drops some"
    assert 400 * SECONDS - counts.pop("imu") in (0, 1, 2)
    rates_hz = {
        "truth": 10,
        "scanner": 10,
        "radar": 10,
        "encoders": 50,
        "worn": 50,
        "odometry": 50,
        "gnss": 5,
        "sonar": 15,
    }
    declared = {name: SECONDS * rates_hz.get(name.rpartition("/")[2], 4) for name in counts}
    assert counts == declared
    assert all(len({body for _, body in bodies}) > 1 for bodies in expected.values())


@pytest.mark.parametrize("factor", FACTORS)
def test_at_the_wall_clocks_pace(factor: float, expected: Heard, paced: dict[float, Run]) -> None:
    """One of the runs was paused and saved at half time."""
    heard = paced[factor].witness.heard()
    paced[factor].rig.stop()
    assert difference(heard, expected) is None


def stopped(pid: int, seconds: float) -> None:
    """Let a process stand still for a while."""
    os.kill(pid, signal.SIGSTOP)
    time.sleep(seconds)
    os.kill(pid, signal.SIGCONT)


def test_started_in_any_order_killed_and_delayed(expected: Heard, tmp_path: Path) -> None:
    """Two processes are killed, two stand still for two seconds, all of them for moments."""
    with run(tmp_path) as it:
        chance = random.Random(8)
        names = chance.sample(it.names, len(it.names))
        assert names.index("physics") > 2, "some are there before it"
        it.rig.start(
            *("-m", "udp_bridge", "listen", "--bind", it.rig.address(it.rig.peer)), log="r"
        )
        it.start(*names)
        it.start_module("gateway", "services.gateway")
        for number, victim in enumerate(("rover/lidar", "gateway"), start=1):
            it.witness.wait(number * 10**9)
            stopped(it.pids[victim], 2.0)
        victims = [(UNTIL_NANOS // 2, "rover/odometry"), (UNTIL_NANOS // 4, "rover/lidar")]
        while (reached_nanos := it.witness.reached_nanos) < UNTIL_NANOS:
            if victims and reached_nanos >= victims[-1][0]:
                _, victim = victims.pop()
                os.kill(it.pids[victim], signal.SIGKILL)
                it.start(victim)
            stopped(it.pids[chance.choice(sorted(it.pids))], chance.uniform(0.001, 0.1))
            time.sleep(chance.uniform(0.0, 0.1))
        assert not victims
        assert difference(it.witness.heard(), expected) is None


def test_restored_from_half_time(expected: Heard, saved: Saved, tmp_path: Path) -> None:
    with run(tmp_path) as it:
        it.start_module("physics", "services.physics", str(saved.file))
        it.start(*(name for name in it.names if name != "physics"))
        after = it.witness.heard()
    whole = {}
    for key, bodies in after.items():
        assert bodies[0][0] > UNTIL_NANOS // 4, "the first half is not told again"
        whole[key] = [*(body for body in saved.before[key] if body[0] < bodies[0][0]), *bodies]
    assert difference(whole, expected) is None


def test_a_sensor_on_another_host(expected: Heard, tmp_path: Path) -> None:
    """Behind a network that takes 2 ms each way, more or less, and loses packets."""
    address = (HOSTS[1], 7447)
    endpoint = f"tcp/{address[0]}:{address[1]}"

    def become(*command: str) -> None:
        os.chdir(REPOSITORY)
        os.execv(sys.executable, [sys.executable, "-m", *command])

    def sensor() -> None:
        wait_for(lambda: is_answered(address), 60, "the other host listens")
        become("services.sensors.lidar", "--name", "rover/lidar", "--connect", endpoint)

    def others() -> None:
        become("tests.system.determined", str(tmp_path), endpoint)

    try:
        link = Impairment(delay_ms=2, jitter_ms=1, loss=0.001)
        run_on_two_hosts((sensor, others), link, mtu=65535, seconds=110)
    except NotAllowed as error:
        pytest.skip(f"no network of its own: {error}")
    there = tmp_path / HEARD
    assert there.exists(), "".join(log.read_text() for log in tmp_path.glob("*.log"))
    heard = msgspec.json.decode(there.read_bytes(), type=Heard)
    assert difference(heard, expected) is None
