# SPDX-License-Identifier: Apache-2.0
"""How long a seek in a recorded run takes: `python -m benchmarks.seek`.

Records a rover that drives around the yard with satellites and encoders, as fast as this machine
allows; starts a run at an instant of it; then puts that run at random instants. The time of a seek
is from the call until physics stands at the instant: reading the file, its checkpoint and journal,
building what moves, and stepping the rest. The same is done with the first minute of the recording,
since a claim is a ratio: the length of a recording must not matter.
"""

import argparse
import random
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from groundlink.bus.control_client import restoring, run_status, send_command
from groundlink.bus.queries import control_key
from groundlink.bus.session import Bus
from groundlink.cli.run.seek import saved_run
from groundlink.core.clock import TICK_SECONDS
from groundlink.episode.control import Pause
from groundlink.loader.scenario_files import SHIPPED
from groundlink.monitor.process_commands import free_endpoint

from .claims import Claim, add_options, judge

RUN = "seek_benchmark"
CHECKPOINTS_S = 5.0
SHORT_S = 60.0
MOST_RATIO = 1.5
"""Of the 95th percentiles of seeks in the whole recording and in its first minute."""

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


@contextmanager
def started(recording: Path) -> Iterator[tuple[Bus, float]]:
    """Start a run in the middle of a recording; yield its bus, and how long that took."""
    endpoint, begun = free_endpoint(), time.monotonic()
    words = ("up", recording, "--at", f"{SHORT_S / 2:g}", "--no-ros", "--run", RUN)
    up = subprocess.Popen(groundlink(*words, "--listen", endpoint), stdout=subprocess.DEVNULL)
    try:
        with Bus(connect=endpoint) as bus:
            while not stands(bus):
                if time.monotonic() - begun > START_SECONDS or up.poll() is not None:
                    raise RuntimeError("the run did not start")
                time.sleep(0.02)
            yield bus, time.monotonic() - begun
    finally:
        up.terminate()
        up.wait()


def stands(bus: Bus) -> bool:
    """Return whether the run stands at its instant."""
    if not bus.query(control_key(RUN), seconds=0.5):
        return False
    status = run_status(bus, RUN)
    return status.restoring_to < 0 and status.tick * TICK_SECONDS == SHORT_S / 2


def seek(bus: Bus, recording: Path, seconds: float) -> float:
    """Put the run at an instant; return the wall time that it took."""
    begun = time.monotonic()
    content = saved_run(recording, seconds)
    send_command(bus, RUN, Pause())
    for answer in restoring(bus, RUN, content):
        tick = answer.tick
    took = time.monotonic() - begun
    if tick != round(seconds / TICK_SECONDS):
        raise RuntimeError(f"the run is at tick {tick}, not at {seconds:g} s")
    return took


def main() -> int:
    """Measure, print, and with --check compare."""
    parser = argparse.ArgumentParser(prog="benchmarks.seek", description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0, help="length of the recording")
    parser.add_argument("--seeks", type=int, default=50, help="number of seeks in each part")
    parser.add_argument("--recording", type=Path, help="use this recording of an earlier call")
    add_options(parser)
    options = parser.parse_args()
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
            took: dict[float, list[float]] = {SHORT_S: [], whole_s: []}
            # In turns, so that both meet the same load of the machine.
            for _ in range(options.seeks):
                for end, times in took.items():
                    times.append(seek(bus, recording, chance.uniform(0.0, end - 1.0)))
    for end, times in took.items():
        print(
            f"seeks within {end:g} s: p50 {statistics.median(times):.3f} s, p95 "
            f"{np.percentile(times, 95):.3f} s, longest {max(times):.3f} s"
        )
    ratio = float(np.percentile(took[whole_s], 95) / np.percentile(took[SHORT_S], 95))
    what = f"p95 of seeks in {options.minutes:g} minutes over that in the first one"
    return judge([Claim(what, ratio, MOST_RATIO, is_at_least=False)], options)


if __name__ == "__main__":
    sys.exit(main())
