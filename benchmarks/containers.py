# SPDX-License-Identifier: Apache-2.0
"""What a container of each kind costs with 1, 4 and 8 vehicles: `python -m benchmarks.containers`.

Rule: what runs is what `groundlink compose` writes, on a real engine, with four light sensors a
vehicle, nobody waited for, so that what is too much shows as readings left out. Processor time and
memory are the engine's own figures, counts those that processes tell of themselves.
"""

from __future__ import annotations

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
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from groundlink.bus import Bus
from groundlink.clock import TICK_SECONDS
from groundlink.deployment import Deployment
from groundlink.gaps import parted
from groundlink.inbox import Inbox
from groundlink.messages import Health
from groundlink.scenario import load
from groundlink.topics import GATEWAY, HEALTH, PHYSICS, process_names

ROOT = Path(__file__).parents[1]
PROJECT = "groundlink-benchmark"
HOST = "127.74.47.2"
SENSORS = ("lidar_2d", "imu", "encoders", "wheel_odometry")
SAMPLES = 4
"""Of the engine's figures, each of which takes it about two seconds."""

SETTLE_SECONDS = 5.0


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


def docker(*words: str) -> str:
    """Return what `docker` prints."""
    return subprocess.run(
        ["docker", *words],
        env=os.environ | {"GROUNDLINK_PUBLISH": HOST},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    ).stdout


@contextmanager
def up(compose_file: Path) -> Iterator[None]:
    """Have the containers of a file for a while."""
    compose = ("compose", "-p", PROJECT, "-f", str(compose_file))
    docker(*compose, "down", "-v", "-t", "3")
    docker(*compose, "build", "-q")
    try:
        docker(*compose, "up", "-d", "--wait", "--wait-timeout", "120")
        yield
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


def beats(bus: Bus, processes: Sequence[str]) -> dict[str, Health]:
    """Return a new word of every process."""
    inbox: Inbox[Health] = Inbox(depth=1024)
    bus.subscribe(HEALTH.key_in("benchmark"), Health, inbox)
    found: dict[str, Health] = {}
    while len(found) < len(processes):
        if arrived := inbox.get(seconds=10):
            found[arrived[1].process] = arrived[1]
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
        with up(compose_file), Bus(connect=f"tcp/{HOST}:7447") as bus:
            time.sleep(SETTLE_SECONDS)
            before, begun = beats(bus, processes), time.monotonic()
            for _ in range(SAMPLES):
                for service, of_cores, mebibytes in samples():
                    cores[service].append(of_cores)
                    memory[service].append(mebibytes)
            after, seconds = beats(bus, processes), time.monotonic() - begun
    return {
        "containers": len(cores),
        "messages_hz": _messages(before, after) / seconds,
        "to_ros_hz": (_sent(after) - _sent(before)) / seconds,
        "left_out": _left_out(before, after),
        "factor": (after[PHYSICS].tick - before[PHYSICS].tick) * TICK_SECONDS / seconds,
        "cores": {kind: _by_kind(cores, kind) for kind in _kinds(cores)},
        "mebibytes": {kind: _by_kind(memory, kind) for kind in _kinds(memory)},
        "all_cores": sum(map(statistics.mean, cores.values())),
        "all_mebibytes": sum(map(statistics.mean, memory.values())),
    }


def _messages(before: dict[str, Health], after: dict[str, Health]) -> int:
    """Return states of physics and readings of sensors."""
    readings = sum(
        after[name].counters.get("readings", 0) - word.counters.get("readings", 0)
        for name, word in before.items()
    )
    return readings + after[PHYSICS].tick - before[PHYSICS].tick


def _sent(words: dict[str, Health]) -> int:
    return sum(row.sent for row in words[GATEWAY].streams if row.direction == "to ROS")


def _left_out(before: dict[str, Health], after: dict[str, Health]) -> float:
    """Return which part of the readings that were due is missing."""
    missing, made = 0, 0
    for name, word in after.items():
        now, then = word.counters, before[name].counters
        missing += sum(parted(now)[0].values()) - sum(parted(then)[0].values())
        made += now.get("readings", 0) - then.get("readings", 0)
    return missing / max(1, missing + made)


def _kind(service: str) -> str:
    return service.rpartition("-")[2]


def _kinds(of: dict[str, list[float]]) -> list[str]:
    return sorted({_kind(service) for service in of})


def _by_kind(of: dict[str, list[float]], kind: str) -> float:
    """Return the mean over the containers of a kind, each of them over its samples."""
    return statistics.mean(statistics.mean(of[s]) for s in of if _kind(s) == kind)


def main() -> int:
    """Measure, and print it as a table of Markdown."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.containers", description=__doc__)
    parser.add_argument("--vehicles", type=int, nargs="+", default=[1, 4, 8])
    sizes: list[int] = parser.parse_args().vehicles
    found = [measure(size) for size in sizes]
    rows = [
        ("containers", [f"{it['containers']}" for it in found]),
        ("states and readings a second", [f"{it['messages_hz']:,.0f}" for it in found]),
        ("messages to ROS a second", [f"{it['to_ros_hz']:,.0f}" for it in found]),
        ("readings left out", [f"{it['left_out']:.1%}" for it in found]),
        ("real-time factor", [f"{it['factor']:.2f}" for it in found]),
        ("all", [f"{it['all_cores']:.2f}, {it['all_mebibytes']:,.0f} MiB" for it in found]),
    ]
    for kind in found[0]["cores"]:
        cells = [f"{it['cores'][kind]:.2f}, {it['mebibytes'][kind]:.0f} MiB" for it in found]
        rows.append((f"each `{kind}`", cells))
    print(f"| vehicles | {' | '.join(map(str, sizes))} |")
    print("|---" * (len(sizes) + 1) + "|")
    for name, cells in rows:
        print(f"| {name} | {' | '.join(cells)} |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
