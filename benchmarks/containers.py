# SPDX-License-Identifier: Apache-2.0
"""Cores and memory of each container with 1, 4 and 8 vehicles: `python -m benchmarks.containers`.

Runs the file of `groundlink compose` on a real engine, with four light sensors a vehicle. The run
waits for no process, so an overload shows as missing readings. Processor time and memory are the
engine's figures, counts those that processes publish as health.
"""

import argparse
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from groundlink.bus.core_topics import GATEWAY, HEALTH, PHYSICS
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.bus.topics import process_names
from groundlink.core.clock import TICK_SECONDS
from groundlink.deploy.compose import Deployment
from groundlink.loader import load
from groundlink.messages.base import Health
from groundlink.messages.missing_readings import parted

ROOT = Path(__file__).parents[1]
PROJECT = "groundlink-benchmark"
HOST = "127.74.47.2"
SENSORS = ("lidar_2d", "imu", "encoders", "wheel_odometry")
SAMPLES = 4
"""Samples of the engine's figures; each takes about two seconds."""

SETTLE_SECONDS = 5.0

UP_SECONDS = 60, 15
"""Timeout until all containers are healthy: the first, plus the second for each container."""

HEALTH_SECONDS = 60.0
"""Timeout for the health of every process, which is published once a second."""

KINDS = ("router", "physics", "scanner", "imu", "encoders", "odometry", "gateway", "ros2")


def write_scenario(vehicles: int, folder: Path) -> Path:
    """Write a scenario of so many rovers in rows of four, with all that it names beside it."""
    for name in ("worlds", "vehicles", "sensors"):
        shutil.copytree(ROOT / "scenarios" / name, folder / name)
    document = yaml.safe_load((ROOT / "scenarios/two_rovers.yaml").read_text(encoding="utf-8"))
    first = document["vehicles"][0]
    document["name"] = "benchmark"
    document["vehicles"] = [
        {
            "name": f"rover_{i}",
            "model": first["model"],
            "placement": {"x_m": -12.0 + 6.0 * (i % 4), "y_m": -4.0 - 6.0 * (i // 4)},
            "sensors": [s for s in first["sensors"] if s["kind"] in SENSORS],
        }
        for i in range(vehicles)
    ]
    file = folder / "benchmark.yaml"
    file.write_text(json.dumps(document), encoding="utf-8")
    return file


def docker(*arguments: str) -> str:
    """Return what `docker` prints."""
    return subprocess.run(
        ["docker", *arguments],
        env=os.environ | {"GROUNDLINK_PUBLISH": HOST},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    ).stdout


@contextmanager
def up(compose_file: Path) -> Iterator[float]:
    """Run the containers of a file; yield the seconds until they were healthy."""
    compose = ("compose", "-p", PROJECT, "-f", str(compose_file))
    docker(*compose, "down", "-v", "-t", "3")
    docker(*compose, "build", "-q")
    containers = len(docker(*compose, "config", "--services").split())
    timeout = UP_SECONDS[0] + UP_SECONDS[1] * containers
    try:
        start = time.monotonic()
        docker(*compose, "up", "-d", "--wait", "--wait-timeout", str(timeout))
        yield time.monotonic() - start
    finally:
        docker(*compose, "down", "-v", "-t", "3")


def samples() -> Iterator[tuple[str, float, float]]:
    """Yield service, cores and MiB of every container, as the engine has them now."""
    names = docker("ps", "--format", "{{.Names}}", "--filter", f"name={PROJECT}-").split()
    for line in docker("stats", "--no-stream", "--format", "{{json .}}", *names).splitlines():
        row = json.loads(line)
        used = row["MemUsage"].split(" / ")[0]
        units = {"GiB": 1024.0, "MiB": 1.0, "KiB": 1 / 1024}
        mebibytes = float(used[:-3]) * units[used[-3:]]
        service = row["Name"].removeprefix(f"{PROJECT}-").rpartition("-")[0]
        yield service, float(row["CPUPerc"].rstrip("%")) / 100, mebibytes


class HealthSample(NamedTuple):
    """The health of a process, and when it arrived."""

    seconds: float
    health: Health


def health_of(bus: Bus, processes: Sequence[str]) -> dict[str, HealthSample]:
    """Return new health of every process; exit if one sends none."""
    inbox: BusInbox[Health] = BusInbox(depth=1024)
    bus.subscribe(HEALTH.key_in("benchmark"), Health, inbox)
    found: dict[str, HealthSample] = {}
    deadline = time.monotonic() + HEALTH_SECONDS
    while missing := set(processes) - set(found):
        if arrived := inbox.get(seconds=1):
            found[arrived[1].process] = HealthSample(time.monotonic(), arrived[1])
        if time.monotonic() > deadline:
            sys.exit(f"no health of {', '.join(sorted(missing))} within {HEALTH_SECONDS:.0f} s")
    return found


def measure(vehicles: int) -> dict[str, Any]:
    """Return the figures of one size."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        folder.chmod(0o755)
        file = write_scenario(vehicles, folder)
        scenario = load(file)
        processes = list(process_names(scenario))
        compose_file = folder / "compose.yaml"
        deployment = Deployment(scenario, file, sources=str(ROOT), overload="skip")
        compose_file.write_text(deployment.compose(), encoding="utf-8")
        cores: dict[str, list[float]] = defaultdict(list)
        memory: dict[str, list[float]] = defaultdict(list)
        with up(compose_file) as up_s, Bus(connect=f"tcp/{HOST}:7447") as bus:
            time.sleep(SETTLE_SECONDS)
            before = health_of(bus, processes)
            for _ in range(SAMPLES):
                for service, of_cores, mebibytes in samples():
                    cores[service].append(of_cores)
                    memory[service].append(mebibytes)
            after = health_of(bus, processes)
    return {
        "containers": len(cores),
        "up_s": up_s,
        "messages_hz": sum(_rate(name, _made, before, after) for name in processes),
        "to_ros_hz": _rate(GATEWAY, _sent, before, after),
        "left_out": _left_out(before, after),
        "factor": _rate(PHYSICS, _made, before, after) * TICK_SECONDS,
        "cores": {kind: _by_kind(cores, kind) for kind in KINDS},
        "mebibytes": {kind: _by_kind(memory, kind) for kind in KINDS},
        "all_cores": sum(map(statistics.mean, cores.values())),
        "all_mebibytes": sum(map(statistics.mean, memory.values())),
    }


def _rate(
    process: str,
    count: Callable[[Health], int],
    before: dict[str, HealthSample],
    after: dict[str, HealthSample],
) -> float:
    """Return how many a second a process has counted between two samples."""
    then, now = before[process], after[process]
    return (count(now.health) - count(then.health)) / (now.seconds - then.seconds)


def _made(health: Health) -> int:
    """Return states of physics, or readings of a sensor."""
    return health.tick if health.process == PHYSICS else health.counters.get("readings", 0)


def _sent(health: Health) -> int:
    return sum(row.sent for row in health.streams if row.direction == "to ROS")


def _left_out(before: dict[str, HealthSample], after: dict[str, HealthSample]) -> float:
    """Return the share of due readings that are missing."""
    missing, made = 0, 0
    for name, sample in after.items():
        now, then = sample.health.counters, before[name].health.counters
        missing += sum(parted(now)[0].values()) - sum(parted(then)[0].values())
        made += now.get("readings", 0) - then.get("readings", 0)
    return missing / max(1, missing + made)


def _kind(service: str) -> str:
    return service.rpartition("-")[2]


def _by_kind(of: dict[str, list[float]], kind: str) -> float:
    """Return the mean over the containers of a kind, each of them over its samples."""
    return statistics.mean(statistics.mean(of[s]) for s in of if _kind(s) == kind)


_COLUMNS = (
    ("containers", "{containers}"),
    ("healthy after", "{up_s:.0f} s"),
    ("states and readings a second", "{messages_hz:,.0f}"),
    ("messages to ROS a second", "{to_ros_hz:,.0f}"),
    ("readings left out", "{left_out:.1%}"),
    ("real-time factor", "{factor:.2f}"),
    ("cores and memory of all", "{all_cores:.2f}, {all_mebibytes:,.0f} MiB"),
)


def main() -> int:
    """Measure and print a Markdown table, row by row."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.containers", description=__doc__)
    parser.add_argument("--vehicles", type=int, nargs="+", default=[1, 4, 8])
    sizes: list[int] = parser.parse_args().vehicles
    columns = ("vehicles", *(name for name, _ in _COLUMNS), *(f"each `{kind}`" for kind in KINDS))
    print(f"| {' | '.join(columns)} |")
    print("|---" * len(columns) + "|", flush=True)
    for size in sizes:
        it = measure(size)
        cells = [str(size), *(form.format(**it) for _, form in _COLUMNS)]
        cells += [f"{it['cores'][kind]:.2f}, {it['mebibytes'][kind]:.0f} MiB" for kind in KINDS]
        print(f"| {' | '.join(cells)} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
