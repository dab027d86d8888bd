# SPDX-License-Identifier: Apache-2.0
"""How much faster than by a run a recording gets another LiDAR: `python -m benchmarks.resim`.

Alternately records the default scenario, with its camera, on the tour of `indoor_lab_tour`, and
simulates the LiDAR of that recording again. Processor time is that of all processes, and holds
whatever else runs; wall time does not.
"""

import argparse
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import yaml

from groundlink.loader.scenario_files import SHIPPED
from groundlink.monitor.process_commands import free_endpoint

from .claims import Claim, add_options, judge

CHANGE = "lidar.dropout=0.1"
SECONDS = 30.0
"""Sim time of a recording: the default of `groundlink record`."""

ROUNDS = 3
LEAST = 5.0
"""Ratio of processor times below which `--check` fails."""


class Cost(NamedTuple):
    """Seconds that a command took."""

    wall: float
    processor: float


def write_scenario(file: Path) -> None:
    """Write the default scenario with a driver."""
    lab, tour = (
        yaml.safe_load((SHIPPED / f"{name}.yaml").read_text(encoding="utf-8"))
        for name in ("indoor_lab", "indoor_lab_tour")
    )
    lab["vehicles"][0]["route"] = tour["vehicles"][0]["route"]
    file.write_text(yaml.safe_dump(lab), encoding="utf-8")


def cost_of(*words: str) -> Cost:
    """Run a command of Groundlink; return its cost with that of all its processes."""
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    command = [sys.executable, "-m", "groundlink", *words]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    wall, after = time.monotonic() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    used = (after.ru_utime - before.ru_utime) + (after.ru_stime - before.ru_stime)
    return Cost(wall, used)


def measured(seconds: float, rounds: int) -> dict[str, list[Cost]]:
    """Return the costs of each round, by command."""
    costs: dict[str, list[Cost]] = {"record": [], "resim": []}
    for _ in range(rounds):
        with tempfile.TemporaryDirectory() as folder:
            run, other = (str(Path(folder, name)) for name in ("run.mcap", "other.mcap"))
            scenario = Path(folder, "driven.yaml")
            write_scenario(scenario)
            whole = ["--duration", f"{seconds:g}", "--listen", free_endpoint(), "--out", run]
            costs["record"].append(cost_of("record", str(scenario), *whole))
            costs["resim"].append(cost_of("resim", run, "--set", CHANGE, "--out", other))
    return costs


def main() -> int:
    """Print medians and ratios; return 1 where a claim that is checked does not hold."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.resim", description=__doc__)
    parser.add_argument("--seconds", type=float, default=SECONDS, help="sim time (%(default)g s)")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help="rounds (%(default)d)")
    add_options(parser)
    options = parser.parse_args()
    costs = measured(options.seconds, options.rounds)
    medians = {
        name: Cost(*map(statistics.median, zip(*each, strict=True))) for name, each in costs.items()
    }
    print(f"{options.seconds:g} s of a drive, medians of {options.rounds} alternating rounds")
    for name, cost in medians.items():
        print(
            f"{name:8} {cost.processor:6.1f} s of processor time, {cost.wall:6.1f} s of wall time"
        )
    record, resim = medians["record"], medians["resim"]
    print(f"ratio of wall times {record.wall / resim.wall:.1f}")
    ratio = record.processor / resim.processor
    claim = Claim("a LiDAR changed, whole run / resim, processor time", ratio, LEAST)
    return judge([claim], options)


if __name__ == "__main__":
    raise SystemExit(main())
