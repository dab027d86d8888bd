# SPDX-License-Identifier: Apache-2.0
"""How long a seek in a recorded run takes: `python -m benchmarks.seek`.

Records a rover that drives around the yard with satellites and encoders, as fast as this machine
allows; starts a run at an instant of it; then puts that run at random instants. The time of a seek
is from the call until physics stands at the instant: reading the file, its checkpoint and journal,
building what moves, and stepping the rest. The same is done with the first minute of the recording,
since a claim is a ratio: the length of a recording must not matter. Before that, it measures the
parts of a seek in shipped scenarios, in processor time.
"""

import argparse
import os
import random
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from groundlink.bus.control_client import restoring, run_status, send_command
from groundlink.bus.queries import control_key
from groundlink.bus.session import Bus
from groundlink.cli.run.seek import saved_run
from groundlink.core.clock import TICK_NANOS, TICK_SECONDS
from groundlink.episode.checkpoint import Checkpoint, dumped
from groundlink.episode.control import Pause
from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.messages.base import Command
from groundlink.monitor.process_commands import free_endpoint
from groundlink.scenario import Scenario
from services.physics.run.episode import Episode
from services.physics.run.publishers import silent_publishers

from .claims import Claim, add_options, judge

RUN = "seek_benchmark"
CHECKPOINTS_S = 5.0
SHORT_S = 60.0
MOST_RATIO = 1.5
"""Of the 95th percentiles of seeks in the whole recording and in its first minute."""

PARTS = ("indoor_lab", "yard", "scanned_room", "outdoor_paper")
"""Scenarios whose physics is measured in parts."""

PART_PERIOD_S, PART_PERIODS = 0.5, 12

START_SECONDS = 120.0
"""Longest wait for the run."""


def scenario_text() -> str:
    """Return the shipped yard with encoders and one receiver of satellites, for many laps."""
    text = (SHIPPED / "yard.yaml").read_text(encoding="utf-8")
    heavy = ("kind: imu", "kind: range", "gnss_cheap")
    lines = [line for line in text.splitlines() if not any(word in line for word in heavy)]
    return "\n".join(lines).replace("closed: true", "closed: true\n      laps: 1000") + (
        "\ntime: {clock_rate_hz: 10.0}\n"
    )


def groundlink(*words: str | Path) -> list[str]:
    """Return the command line of a command."""
    return [sys.executable, "-m", "groundlink", *map(str, words)]


def record(scenario: Path, out: Path, seconds: float) -> None:
    """Record a run with checkpoints."""
    words = ("record", scenario, "--duration", f"{seconds:g}", "--out", out, "--run", RUN)
    command = groundlink(*words, "--checkpoints", f"{CHECKPOINTS_S:g}", "--listen", free_endpoint())
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


class SeekTimes(NamedTuple):
    """What one seek took, in seconds."""

    wall_s: float
    processor_s: float
    """Of physics and of the command."""


@contextmanager
def started(recording: Path) -> Iterator[tuple[Bus, float]]:
    """Start a run in the middle of a recording; yield its bus, and how long that took."""
    endpoint, begun = free_endpoint(), time.monotonic()
    words = ("up", recording, "--at", f"{SHORT_S / 2:g}", "--no-ros", "--run", RUN)
    up = subprocess.Popen(groundlink(*words, "--listen", endpoint), stdout=subprocess.DEVNULL)
    host, _, port = endpoint.removeprefix("tcp/").partition(":")
    try:
        wait_for(lambda: is_answered(host, int(port)))
        with Bus(connect=endpoint) as bus:
            wait_for(lambda: stands(bus))
            yield bus, time.monotonic() - begun
    finally:
        up.terminate()
        up.wait()


def wait_for(condition: Callable[[], bool]) -> None:
    """Wait until a condition holds."""
    deadline = time.monotonic() + START_SECONDS
    while not condition():
        if time.monotonic() > deadline:
            raise RuntimeError(f"the run did not start within {START_SECONDS:g} s")
        time.sleep(0.02)


def is_answered(host: str, port: int) -> bool:
    """Return whether a process listens at an address."""
    with socket.socket() as probe:
        return probe.connect_ex((host, port)) == 0


def stands(bus: Bus) -> bool:
    """Return whether the run stands at its instant."""
    if not bus.query(control_key(RUN), seconds=0.5):
        return False
    status = run_status(bus, RUN)
    return status.restoring_to < 0 and status.tick * TICK_SECONDS == SHORT_S / 2


def physics_seconds() -> float:
    """Return the processor time of the run's physics so far."""
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            words = (folder / "cmdline").read_bytes().split(b"\0")
            if {b"services.physics", RUN.encode()} <= {*words}:
                fields = (folder / "stat").read_text(encoding="ascii").rpartition(")")[2].split()
                return sum(map(int, fields[11:13])) / os.sysconf("SC_CLK_TCK")
    raise RuntimeError("physics does not run")


def seek(bus: Bus, recording: Path, seconds: float) -> SeekTimes:
    """Put the run at an instant; return the time that it took."""
    begun, used = time.monotonic(), time.process_time() + physics_seconds()
    content = saved_run(recording, seconds)
    send_command(bus, RUN, Pause())
    for answer in restoring(bus, RUN, content):
        tick = answer.tick
    took = SeekTimes(time.monotonic() - begun, time.process_time() + physics_seconds() - used)
    if tick != round(seconds / TICK_SECONDS):
        raise RuntimeError(f"the run is at tick {tick}, not at {seconds:g} s")
    return took


def print_parts(name: str) -> None:
    """Print the processor time of what a seek consists of, and that of a checkpoint."""
    scenario = load(name)
    fast = replace(scenario.time, mode="fast", checkpoint_s=PART_PERIOD_S)
    scenario = replace(scenario, time=fast)
    period = round(PART_PERIOD_S / TICK_SECONDS)
    episode = begun_episode(scenario)
    steps: dict[bool, list[float]] = {False: [], True: []}
    while episode.tick < PART_PERIODS * period:
        if episode.tick % 20 == 0:
            stamp = episode.epoch_nanos + episode.tick * TICK_NANOS
            for vehicle in scenario.vehicles:
                episode.command(vehicle.name, Command(stamp, (0.8, 0.0, 0.0), (0.0, 0.0, 0.3)))
        begun = time.process_time()
        episode.step()
        steps[episode.tick % period == 0].append(time.process_time() - begun)
    checkpoint = episode.checkpoints.complete[-1]
    begun = time.process_time()
    again = begun_episode(scenario, checkpoint)
    begin_ms = (time.process_time() - begun) * 1e3
    again.end()
    episode.end()
    step_ms = statistics.mean(steps[False]) * 1e3
    print(
        f"{name:14} {step_ms / TICK_SECONDS:4.0f} ms for a second of sim time, {begin_ms:4.0f} ms "
        f"to begin at a checkpoint; {statistics.median(steps[True]) * 1e3 - step_ms:4.1f} ms to "
        f"make one, {len(dumped(checkpoint))} bytes without acknowledgements",
        flush=True,
    )


def begun_episode(scenario: Scenario, checkpoint: Checkpoint | None = None) -> Episode:
    """Return an episode that publishes nothing, at its first state."""
    episode = Episode(
        *(scenario, RUN, silent_publishers()), required=(), wall_nanos=0, checkpoint=checkpoint
    )
    episode.begin(0, 0.0)
    return episode


def main() -> int:
    """Measure, print, and with --check compare."""
    parser = argparse.ArgumentParser(prog="benchmarks.seek", description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0, help="length of the recording")
    parser.add_argument("--seeks", type=int, default=50, help="number of seeks in each part")
    parser.add_argument("--recording", type=Path, help="use this recording of an earlier call")
    add_options(parser)
    options = parser.parse_args()
    for name in PARTS:
        print_parts(name)
    whole_s, chance = options.minutes * 60.0, random.Random(1)
    with tempfile.TemporaryDirectory() as folder:
        recording = options.recording or Path(folder, "run.mcap")
        if not recording.exists():
            scenario = Path(folder, "scenario.yaml")
            scenario.write_text(scenario_text(), encoding="utf-8")
            begun = time.monotonic()
            record(scenario, recording, whole_s)
            print(f"recorded {whole_s:g} s in {time.monotonic() - begun:.0f} s")
        with started(recording) as (bus, seconds):
            print(f"from the command to a run that stands at an instant: {seconds:.2f} s")
            seek(bus, recording, SHORT_S / 2)
            took: dict[float, list[SeekTimes]] = {SHORT_S: [], whole_s: []}
            # In turns, so that both meet the same load of the machine.
            for _ in range(options.seeks):
                for end, times in took.items():
                    times.append(seek(bus, recording, chance.uniform(0.0, end - 1.0)))
    for end, times in took.items():
        wall, processor = zip(*times, strict=True)
        print(f"seeks within {end:g} s: {spread(wall)}; processor time: {spread(processor)}")
    long, short = (
        float(np.percentile([each.processor_s for each in took[end]], 95))
        for end in (whole_s, SHORT_S)
    )
    what = f"p95 of seeks in {options.minutes:g} minutes over that in the first one"
    return judge([Claim(what, long / short, MOST_RATIO, is_at_least=False)], options)


def spread(times: Sequence[float]) -> str:
    """Return percentiles of times as text."""
    middle, most = np.percentile(times, [50, 95])
    return f"p50 {middle:.3f} s, p95 {most:.3f} s, longest {max(times):.3f} s"


if __name__ == "__main__":
    sys.exit(main())
