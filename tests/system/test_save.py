# SPDX-License-Identifier: Apache-2.0
"""System tests of saved runs: a restored run publishes the same bytes as an uninterrupted run."""

import subprocess
import sys
from pathlib import Path

import msgspec
import pytest
from msgspec.structs import replace

from groundlink.bus.control_client import run_status, send_command
from groundlink.bus.core_topics import STATE
from groundlink.bus.inbox import BusInbox
from groundlink.bus.queries import control_key, faults_key, journal_key
from groundlink.bus.session import Bus
from groundlink.bus.topics import SENSOR_TOPICS
from groundlink.core.clock import TICK_NANOS
from groundlink.episode.control import Pause, Remove, Restore, Resume, Spawn, Step
from groundlink.episode.fault_messages import FaultAnswer
from groundlink.episode.journal import Commanded, dumped, encode_entry, loaded, state_digest
from groundlink.loader.additions import SpawnPlace, addition
from groundlink.messages.base import Command, Imu, M, State, decode, encode
from groundlink.scenario.faults import Delay, Drop, Fault, Stuck

from .determined import RUN, Heard, Run, Witness, run
from .rig import rig, wait_for

pytestmark = [pytest.mark.system, pytest.mark.timeout(300)]

SAVED_TICK = 1213
"""Not a multiple of any period, and little after the last change of the world."""

END_TICK = 2400
END_NANOS = END_TICK * TICK_NANOS

QUIET_LOOKS = 10


class States(BusInbox[State]):
    """What physics says of every tick, but for its episode."""

    def __init__(self, bus: Bus) -> None:
        super().__init__(depth=1)
        self.digests: dict[int, str] = {}
        bus.subscribe(STATE.key_in(RUN), State, self)

    def put(self, key: str, payload: bytes, message_type: type[M]) -> None:
        state = decode(payload, State)
        self.digests[state.tick] = state_digest(state)

    def assert_go_on(self, expected: dict[int, str]) -> None:
        """Check the states of a run that was restored."""
        assert sorted(self.digests) == list(range(SAVED_TICK, max(self.digests) + 1))
        both = self.digests.keys() & expected.keys()
        assert all(self.digests[tick] == expected[tick] for tick in both)


def command(it: Run, *words: str) -> str:
    """Return what a command of the run prints."""
    line = [sys.executable, "-m", "groundlink", *words, "--connect", it.rig.endpoint]
    done = subprocess.run(line, capture_output=True, text=True, timeout=100, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


def spawn(bus: Bus, what: str, at: SpawnPlace) -> None:
    _, more = addition(what, at=at, name=None, taken=(), ground=None)
    send_command(bus, RUN, Spawn(more))


def suffer(bus: Bus, sensor: str, fault: Fault) -> None:
    request = msgspec.json.encode(fault).decode()
    (answer,) = bus.query(faults_key(RUN, sensor), request, seconds=30).values()
    assert not msgspec.json.decode(answer, type=FaultAnswer).error


def step_to(bus: Bus, tick: int) -> None:
    send_command(bus, RUN, Step(tick - max(run_status(bus, RUN).tick, 0)))
    wait_for(lambda: run_status(bus, RUN).tick == tick, 60, f"tick {tick} is stepped to")


def quiet(witness: Witness) -> Heard:
    """Return what has been heard when nothing more comes."""
    last: list[Heard] = []

    def is_quiet() -> bool:
        last.append(witness.so_far())
        return last[-QUIET_LOOKS:] == QUIET_LOOKS * last[-1:]

    wait_for(is_quiet, 60, "silence")
    return last[-1]


def together(first: Heard, second: Heard) -> Heard:
    """Return two halves as somebody has them who knows a body by its instant."""
    return {
        key: [*bodies, *(body for body in second[key] if not bodies or body[0] > bodies[-1][0])]
        for key, bodies in first.items()
    }


def until_the_end(witness: Witness) -> Heard:
    """Return what was heard up to the end, when all of it has come."""
    witness.wait(END_NANOS)
    found = witness.so_far()
    return {key: [body for body in bodies if body[0] < END_NANOS] for key, bodies in found.items()}


def test_restored_here_and_elsewhere_a_run_goes_on_with_the_same_bytes(tmp_path: Path) -> None:
    file, elsewhere = tmp_path / "half_way.run", tmp_path / "elsewhere"
    elsewhere.mkdir()
    with run(tmp_path) as it, Bus(connect=it.rig.endpoint) as bus:
        it.start("physics")
        wait_for(lambda: bool(bus.query(control_key(RUN), seconds=1)), 30, "physics is there")
        send_command(bus, RUN, Pause())
        states = States(bus)
        it.start(*(name for name in it.names if name != "physics"))
        step_to(bus, 300)
        spawn(bus, "crate", SpawnPlace(-6.0, -4.0))
        suffer(bus, "rover/lidar", Drop(share=0.2))
        step_to(bus, 700)
        spawn(bus, "box", SpawnPlace(-4.0, -7.0))
        suffer(bus, "rover/encoders", Stuck(for_s=5.0))
        suffer(bus, "rover/imu", Delay(delay_s=0.1))
        step_to(bus, 1200)
        send_command(bus, RUN, Remove("box"))
        step_to(bus, SAVED_TICK)
        said = command(it, "save", str(file))
        assert said.startswith(f"run `{RUN}`: saved tick {SAVED_TICK} (3.0325 s) to {file}")
        first = quiet(it.witness)
        send_command(bus, RUN, Resume())
        whole = until_the_end(it.witness)
        send_command(bus, RUN, Pause())
        quiet(it.witness)

        expected, states.digests = states.digests, {}
        again = Witness(bus, it.rig.scenario)
        said = command(it, "restore", str(file))
        # On a busy machine a line of progress comes before.
        assert said.endswith(f"run `{RUN}` is paused at tick {SAVED_TICK} (3.0325 s)\n")
        send_command(bus, RUN, Resume())
        assert together(first, until_the_end(again)) == whole
        states.assert_go_on(expected)

    with run(elsewhere) as it, Bus(connect=it.rig.endpoint) as bus:
        states = States(bus)
        it.start_module("physics", "services.physics", str(file))
        it.start(*(name for name in it.names if name != "physics"))
        assert together(first, until_the_end(it.witness)) == whole
        states.assert_go_on(expected)


@pytest.mark.parametrize("mode", ["fast", "realtime"])
def test_a_run_is_saved_and_restored_while_it_runs(tmp_path: Path, mode: str) -> None:
    """By the bus alone; what a sensor says again is what it said before."""
    section = f"time: {{mode: {mode}, epoch: zero}}\n"
    with rig(tmp_path, time_section=section) as it:
        physics = ("-m", "services.physics", str(it.scenario), "--listen", it.endpoint)
        alone = ("--only", "rover/imu", "--wait-for", "rover/imu", "--run", it.run)
        it.start(*physics, *alone, log="physics.log")
        wait_for(it.is_answered, 60, "physics listens")
        with Bus(connect=it.endpoint) as bus:
            samples: BusInbox[Imu] = BusInbox(depth=1_000_000)
            bus.subscribe(
                SENSOR_TOPICS["imu"].key_in(it.run, vehicle="rover", sensor="imu"), Imu, samples
            )
            sensor = ("-m", "services.sensors.imu", "--name", "rover/imu", "--run", it.run)
            it.start(*sensor, "--connect", it.endpoint, log="imu.log")
            wait_for(lambda: len(samples) > 100, 60, "samples come")
            content = b"".join(bus.query(journal_key(it.run), seconds=30).values())
            saved = loaded(content, "the bus")
            assert not run_status(bus, it.run).paused
            end_nanos = (saved.tick + 400) * TICK_NANOS
            before = heard(samples, end_nanos)
            send_command(bus, it.run, Restore(), content=content)
            wait_for(lambda: run_status(bus, it.run).restoring_to < 0, 60, "it is restored")
            assert run_status(bus, it.run).warning == ""
            again = heard_again(samples, max(before), saved.tick * TICK_NANOS, end_nanos)
            nobody = Commanded(saved.tick, "nobody", Command(0, (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
            foreign = dumped(replace(saved, entries=(encode_entry(nobody),)))
            send_command(bus, it.run, Restore(), content=foreign)
            wait_for(lambda: run_status(bus, it.run).restoring_to < 0, 60, "it is given up")
            assert "there is no vehicle 'nobody'" in run_status(bus, it.run).failure
            reached = max(again)
            wait_for(lambda: max(heard(samples, reached + 1)) > end_nanos, 60, "it goes on")
        assert set(again) >= {n for n in before if saved.tick * TICK_NANOS <= n < end_nanos}
        assert all(before.get(nanos, body) == body for nanos, body in again.items())


def heard(samples: BusInbox[Imu], until_nanos: int) -> dict[int, bytes]:
    """Return samples up to an instant, by their stamps."""
    found: dict[int, bytes] = {}
    while max(found, default=0) < until_nanos:
        arrived = samples.get(seconds=60)
        assert arrived, "the sensor fell silent"
        found[arrived[1].stamp_nanos] = encode(arrived[1])
    return found


def heard_again(
    samples: BusInbox[Imu], last: int, from_nanos: int, until_nanos: int
) -> dict[int, bytes]:
    """Return samples from where time has jumped back, up to an instant.

    It may have jumped before another sample came behind the last one that was heard.
    """
    while arrived := samples.get(seconds=60):
        stamp = arrived[1].stamp_nanos
        if stamp < last:
            break
        last = stamp
    assert arrived, "time never jumped back"
    assert stamp <= from_nanos, "nothing was left out"
    return {stamp: encode(arrived[1])} | heard(samples, until_nanos)
