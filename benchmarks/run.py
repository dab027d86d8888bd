# SPDX-License-Identifier: Apache-2.0
"""Cost of a run by process, and age of its data by hop: `python -m benchmarks.run`.

Runs what `groundlink up` starts for a scenario. The first part measures, for each process,
processor time, context switches, wait for a processor (the kernel's run queue), threads and memory.
All are given for a second of sim time, so a run that other programs slow down can be compared: its
real-time factor stands beside them. On a busy machine `--set time.factor=0.25` leaves the run room
to keep its pace. The second part joins the bus as one more subscriber, which costs the run
something, and measures how old states and readings are when they get there. Ages in ROS are those
that the ROS side reports during the first part.
"""

import argparse
import itertools
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

import yaml
from rich.console import Console

from groundlink.bus.core_topics import HEALTH, PHYSICS, STATE, is_passed_locally
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.cli.terminal.tables import Column, FittingTable
from groundlink.core.clock import TICK_SECONDS
from groundlink.core.errors import UserError
from groundlink.loader import load
from groundlink.loader.overrides import add_argument, forwarded
from groundlink.messages.base import Health, State, measured_nanos
from groundlink.monitor.process_commands import free_endpoint
from groundlink.ros.streams import outgoing
from groundlink.scenario import Scenario

DEFAULT = Path(__file__).parents[1] / "scenarios" / "indoor_lab.yaml"
RUN = "benchmark"
START_SECONDS = 120.0
"""Timeout for a report of every stream by the ROS side."""

SETTLE_SECONDS = 5.0
"""Time between the arrival of every stream and the first part."""

PROBE_SECONDS = 5.0
"""Duration of the second part."""

SPACING_M = 1.5
"""Distance between the vehicles of `--rovers`, along x."""

LEAST_FACTOR = 0.98
"""Real-time factor below which ages say nothing."""

INBOX_MESSAGES = 4096
TICKS_PER_SECOND = os.sysconf("SC_CLK_TCK")
LEFT_OUT = ("missed_ticks", "bus_dropped", "gap_")
"""Prefixes of the counters of what a process has lost or left out."""

Figures = dict[str, float]
COLUMNS = {
    "user": "user %",
    "system": "system %",
    "cpu": "CPU %",
    "voluntary": "switches/s",
    "involuntary": "preempted/s",
    "queued": "queued %",
    "threads": "threads",
    "memory": "PSS MB",
}
"""Figures of a process with their heads. Shares are of one core."""

PER_SECOND = ("user", "system", "cpu", "voluntary", "involuntary", "queued")


def scenario_file(folder: Path, given: Path, rovers: int, without: Sequence[str]) -> Path:
    """Write a scenario whose first vehicle stands there several times, without some kinds."""
    here = given.resolve().parent
    document = yaml.safe_load(given.read_text(encoding="utf-8"))
    document["world"] = str(here / document["world"])
    (first,) = document["vehicles"][:1]
    first["model"] = str(here / first["model"])
    first["sensors"] = [one for one in first["sensors"] if one["kind"] not in without]
    for one in first["sensors"]:
        if "datasheet" in one:
            one["datasheet"] = str(here / one["datasheet"])
    if rovers > 1:
        # Names without a slash in front stand in the namespace of their vehicle.
        for one in first["sensors"]:
            one["topic"] = one["topic"].lstrip("/")
        first["from_ros"] = {k: v.lstrip("/") for k, v in first.get("from_ros", {}).items()}
        x_m = first["placement"]["x_m"]
        document["vehicles"] = [
            first
            | {
                "name": f"{first['name']}{number}",
                "placement": first["placement"] | {"x_m": x_m + number * SPACING_M},
            }
            for number in range(rovers)
        ]
    file = folder / "run.yaml"
    file.write_text(json.dumps(document), encoding="utf-8")
    return file


def descendants(root: int) -> Iterator[int]:
    """Yield a process and all processes that it has started."""
    children = defaultdict(list)
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            stat = (folder / "stat").read_text(encoding="utf-8", errors="replace")
        except OSError:
            continue  # it has ended meanwhile
        children[int(stat.rpartition(")")[2].split()[1])].append(int(folder.name))
    waiting = [root]
    while waiting:
        waiting += children[(pid := waiting.pop())]
        yield pid


def name_of(pid: int) -> str:
    """Return what a process is called: its sensors, or its module."""
    words = Path(f"/proc/{pid}/cmdline").read_text(encoding="utf-8").split("\0")
    names = [after for word, after in itertools.pairwise(words) if word == "--name"]
    modules = [after for word, after in itertools.pairwise(words) if word == "-m"]
    return "+".join(names) or (modules or ["?"])[0].removeprefix("services.")


def figures_of(pid: int) -> Figures:
    """Return the counters of a process since its start: seconds and counts; its memory in MB."""
    found: Figures = dict.fromkeys(COLUMNS, 0.0)
    process = Path(f"/proc/{pid}")
    fields = (process / "stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    found["user"], found["system"] = (int(field) / TICKS_PER_SECOND for field in fields[11:13])
    for thread in (process / "task").iterdir():
        try:
            running, queued, _ = (thread / "schedstat").read_text(encoding="utf-8").split()
            status = (thread / "status").read_text(encoding="utf-8")
        except OSError:
            continue  # it has ended meanwhile
        found["threads"] += 1
        found["cpu"] += int(running) / 1e9
        found["queued"] += int(queued) / 1e9
        for line in status.splitlines():
            if line.startswith("voluntary_ctxt"):
                found["voluntary"] += int(line.split()[1])
            elif line.startswith("nonvoluntary_ctxt"):
                found["involuntary"] += int(line.split()[1])
    for line in (process / "smaps_rollup").read_text(encoding="utf-8").splitlines():
        if line.startswith("Pss:"):
            found["memory"] = int(line.split()[1]) / 1024
    return found


def busy_seconds() -> float:
    """Return the processor time that the whole machine has spent."""
    fields = Path("/proc/stat").read_text(encoding="utf-8").split("\n", 1)[0].split()[1:]
    user, nice, system, _, _, irq, softirq, steal = (int(field) for field in fields[:8])
    return (user + nice + system + irq + softirq + steal) / TICKS_PER_SECOND


class HealthReports:
    """The health messages of a run, from the bus."""

    def __init__(self, bus: Bus) -> None:
        self._inbox: BusInbox[Health] = BusInbox(depth=4096)
        bus.subscribe(HEALTH.key_in(RUN), Health, self._inbox)
        self.newest: dict[str, Health] = {}
        self.ages: defaultdict[str, list[tuple[float, float]]] = defaultdict(list)
        """By topic: median and 99th percentile of the age in ROS, as each report had them."""

        self.tick_seconds = (0.0, 0.0)
        """Sim time in physics' newest report, and wall time of its arrival."""

    def update(self, seconds: float = 0.0) -> None:
        """Record the messages that have arrived and those that arrive within this time."""
        deadline = time.monotonic() + seconds
        while arrived := self._inbox.get(seconds=max(0.0, deadline - time.monotonic())):
            health = arrived[1]
            self.newest[health.process] = health
            if health.process == PHYSICS:
                self.tick_seconds = health.tick * TICK_SECONDS, time.monotonic()
            for stream in health.streams:
                if stream.age_seconds is not None and stream.age_p99_seconds is not None:
                    self.ages[stream.topic].append((stream.age_seconds, stream.age_p99_seconds))

    def wait_for_physics(self) -> tuple[float, float]:
        """Return sim and wall time at the next report of physics."""
        before = self.tick_seconds
        while self.tick_seconds == before:
            self.update(0.02)
        return self.tick_seconds

    @property
    def everything_arrives(self) -> bool:
        """Whether the ROS side has got every stream with a rate."""
        streams = [row for health in self.newest.values() for row in health.streams]
        declared = [row for row in streams if row.declared_hz is not None]
        return bool(declared) and all(row.messages and row.reported for row in declared)

    def left_out(self) -> Counter[str]:
        """Return what processes have lost or left out so far."""
        return Counter(
            {
                f"{health.process} {name}": count
                for health in self.newest.values()
                for name, count in health.counters.items()
                if name.startswith(LEFT_OUT)
            }
        )


def costs(processes_of: Iterable[int], reports: HealthReports, seconds: float) -> dict[str, Any]:
    """Measure processes, by their ids, and the run that they belong to for some seconds."""
    sim_from, wall_from = reports.wait_for_physics()
    busy_from, lost_from = busy_seconds(), reports.left_out()
    pids = {pid: name_of(pid) for pid in processes_of}
    before = {pid: figures_of(pid) for pid in pids}
    reports.ages.clear()
    reports.update(seconds)
    sim_to, wall_to = reports.wait_for_physics()
    after = {pid: figures_of(pid) for pid in pids}
    busy = busy_seconds() - busy_from
    sim, wall = sim_to - sim_from, wall_to - wall_from
    processes: dict[str, Figures] = {}
    for pid, name in pids.items():
        processes[name] = {
            field: (after[pid][field] - before[pid][field]) / sim
            if field in PER_SECOND
            else after[pid][field]
            for field in COLUMNS
        }
    used = sum(row["cpu"] for row in processes.values()) * sim
    return {
        "sim_seconds": sim,
        "real_time_factor": sim / wall,
        "others_cores": (busy - used) / wall,
        "left_out": dict(reports.left_out() - lost_from),
        "processes": processes,
        "total": {field: sum(row[field] for row in processes.values()) for field in COLUMNS},
        "ages_ms": {
            topic: [statistics.median(column) * 1e3 for column in zip(*rows, strict=True)]
            for topic, rows in reports.ages.items()
        },
    }


def bus_ages(endpoint: str, scenario: Scenario) -> dict[str, list[float]]:
    """Return the ages of states and streams at a subscriber of the bus, as `percentiles`."""
    streams = outgoing(scenario, RUN)
    states = STATE.key_in(RUN)
    names = {states: STATE.name} | {row.key: row.topic for row in streams}
    ages_ms: defaultdict[str, list[float]] = defaultdict(list)
    with Bus(connect=endpoint, observer=True) as bus:
        inbox = bus.local_inbox(depth=INBOX_MESSAGES)
        bus.subscribe_local(states, State, inbox)
        for row in streams:
            if is_passed_locally(scenario.time.mode, row.declared_hz, bulky=row.bulky):
                bus.subscribe_local(row.key, row.message, inbox)
            else:
                bus.subscribe(row.key, row.message, inbox)
        deadline = time.monotonic() + PROBE_SECONDS
        while (left := deadline - time.monotonic()) > 0:
            if arrived := inbox.get(seconds=left):
                key, message = arrived
                ages_ms[names[key]].append((time.time_ns() - measured_nanos(message)) / 1e6)
    return {name: percentiles(values) for name, values in ages_ms.items()}


def percentiles(values: Sequence[float]) -> list[float]:
    """Return the median and the 99th percentile."""
    ordered = sorted(values)
    return [statistics.median(ordered), ordered[int(0.99 * (len(ordered) - 1))]]


def joined(endpoint: str, deadline: float) -> Bus:
    """Return a session as soon as the run's router listens; at the deadline, raise its error."""
    while True:
        try:
            return Bus(connect=endpoint, observer=True)
        except UserError:
            if time.monotonic() > deadline:
                raise


def measure(
    file: Path,
    seconds: float,
    more: Sequence[str] = (),
    beside: Callable[[Bus], AbstractContextManager[None]] = lambda bus: nullcontext(),
    *,
    ages: bool = True,
) -> dict[str, Any]:
    """Run a scenario, with more arguments for `groundlink up`, and measure it.

    Parameters
    ----------
    beside
        what goes on during the first part, with a session on the run's bus.
    ages
        whether there is a second part.

    Raises
    ------
    RuntimeError
        when it ends, or its streams do not all arrive.
    """
    scenario, endpoint = load(str(file)), free_endpoint()
    command = ["-m", "groundlink", "up", str(file), "--run", RUN, "--listen", endpoint, *more]
    with (
        tempfile.TemporaryFile("w+") as output,
        subprocess.Popen([sys.executable, *command], stdout=output, stderr=output) as up,
    ):
        try:
            deadline = time.monotonic() + START_SECONDS
            with joined(endpoint, deadline) as bus, beside(bus):
                reports = HealthReports(bus)
                while not reports.everything_arrives:
                    reports.update(0.2)
                    if up.poll() is not None or time.monotonic() > deadline:
                        output.seek(0)
                        raise RuntimeError(f"the run did not start:\n{output.read()}")
                reports.update(SETTLE_SECONDS)
                found = costs(descendants(up.pid), reports, seconds)
            return found | {"bus_ages_ms": bus_ages(endpoint, scenario) if ages else {}}
        finally:
            up.terminate()


def show(console: Console, found: Mapping[str, Any], before: Mapping[str, Any] | None) -> None:
    """Print the tables of a measurement, beside an earlier one."""
    earlier = before or {}
    columns = (Column("process", "path"), *(Column(head) for head in COLUMNS.values()))
    table = FittingTable("for one second of sim time", columns, padding=1)
    rows = {**found["processes"], "all": found["total"]}
    rows_before = {**earlier.get("processes", {}), "all": earlier.get("total")}
    for name in {**rows, **rows_before} if before else rows:
        cells = (cell(field, rows.get(name), rows_before.get(name)) for field in COLUMNS)
        table.add_row(name, *cells)
    console.print(table)
    heads = ("on the bus p50", "p99", "in ROS p50", "ROS p99")
    ages = FittingTable(
        "age in ms", (Column("stream", "path"), *(Column(head) for head in heads)), padding=1
    )
    for name in {**found["bus_ages_ms"], **found["ages_ms"]}:
        texts = []
        for part in ("bus_ages_ms", "ages_ms"):
            pair, pair_before = found[part].get(name), earlier.get(part, {}).get(name)
            for index in range(2):
                now = f"{pair[index]:.1f}" if pair else "-"
                texts.append(f"{pair_before[index]:.1f} > {now}" if pair_before else now)
        ages.add_row(name, *texts)
    if found["real_time_factor"] > LEAST_FACTOR:
        console.print(ages)
    else:
        console.print("no ages: the run is slower than real time")
    for when, one in (("before", before), ("now", found)) if before else (("", found),):
        if one is not None:
            lost = ", ".join(f"{what} {count}" for what, count in one["left_out"].items())
            console.print(
                f"{when} real-time factor {one['real_time_factor']:.3f} over "
                f"{one['sim_seconds']:.1f} s of sim time; other programs took "
                f"{one['others_cores']:.2f} cores; lost or left out: {lost or 'nothing'}".strip()
            )


def cell(field: str, now: Figures | None, before: Figures | None) -> str:
    """Return the text of a figure, after the earlier one."""
    scale = 100.0 if COLUMNS[field].endswith("%") else 1.0
    texts = [f"{row[field] * scale:.{int(scale > 1)}f}" for row in (before, now) if row]
    return " > ".join(texts)


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="benchmarks.run", description=__doc__)
    parser.add_argument("--scenario", type=Path, default=DEFAULT, help="file (%(default)s)")
    parser.add_argument("--seconds", type=float, default=20.0, help="of the first part")
    parser.add_argument("--rovers", type=int, default=1, help="copies of its first vehicle")
    parser.add_argument(
        "--without", action="append", default=[], metavar="KIND", help="leave out these sensors"
    )
    add_argument(parser)
    parser.add_argument("--out", type=Path, metavar="FILE.json", help="write the figures")
    parser.add_argument("--before", type=Path, metavar="FILE.json", help="compare with these")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        file = scenario_file(Path(folder), options.scenario, options.rovers, options.without)
        found = measure(file, options.seconds, forwarded(options))
    if options.out:
        options.out.write_text(json.dumps(found, indent=1), encoding="utf-8")
    before = json.loads(options.before.read_text(encoding="utf-8")) if options.before else None
    show(Console(width=None if sys.stdout.isatty() else 140), found, before)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
