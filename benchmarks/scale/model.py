# SPDX-License-Identifier: Apache-2.0
"""Fleets on more hosts than there are here: `python -m benchmarks.scale.model`.

A discrete-event model of a run in real time. Jobs wait for their process, then for a core of its
host; messages between hosts wait for the cable. How long a job takes was measured (`costs.json`,
written by `--calibrate`). One host has physics, router, gateway and ROS node, the others the
sensors of an equal share of the rovers. Sim time waits for sensors that are behind, as by default.
Prints how busy each process is, how fast sim time passes, and how old inertial readings get in ROS.
"""

import argparse
import json
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from groundlink.bus.core_topics import BATCH_TICKS
from groundlink.core.clock import TICK_SECONDS

from .costs import ENCODER_TICKS, SCAN_TICKS, Costs, fitted
from .events import Cable, Host, Loop, Process

COSTS, MEASURED = (Path(__file__).with_name(f"{name}.json") for name in ("costs", "measured"))
IMU_BYTES, SCAN_BYTES, STATE_BYTES, OTHER_STATE_BYTES = 400, 6600, 170, 500
"""Bytes of a message on the bus; of a state, without vehicles and of each vehicle."""

CABLE_BYTES = 125e6
"""Bytes that a cable carries a second, each way: Gigabit Ethernet."""

SECONDS = 2.0
"""Wall time of a model run."""

WINDOW_TICKS = 64
"""Ticks that sensors may be behind physics. Fewer than by default: the speed of a run is the same,
and settles sooner."""

RETRY_SECONDS = 1e-3
MOST_BEHIND_SECONDS = 0.2
"""Work that waits for a process at the end of a run that it does not keep up with."""

LEAST_FACTOR = 0.98


@dataclass(frozen=True)
class Prediction:
    """What the model says of a run."""

    rovers: int
    hosts: int
    factor: float
    """Speed of sim time, of the wall clock's."""

    busy: dict[str, float]
    """Share of a core that the busiest process of each role takes, of its cores that a host takes,
    and of the first host's cable."""

    cores: dict[str, float]
    """Processor time of each role for a second of sim time."""

    network_bytes: float
    """Bytes on all cables for a second of sim time."""

    ages_ms: tuple[float, float]
    """Median and 99th percentile of the age of inertial readings in ROS."""

    behind: tuple[str, ...]
    """Processes and cables that fall behind while sim time goes on."""

    @property
    def holds(self) -> bool:
        """Whether the run keeps to real time and leaves nothing out."""
        return self.factor > LEAST_FACTOR and not self.behind

    @property
    def bottleneck(self) -> str:
        """The role, host or cable with the largest share in `busy`."""
        return max(self.busy, key=self.busy.__getitem__)


class Run:
    """A run of rovers on hosts.

    Parameters
    ----------
    hosts
        hosts of sensors besides the first; 0: all is on one host.
    cores
        of each host. The sensors on one host, with physics, have up to as many processes of each
        kind; a host of sensors has one of each, since all get copies of the states by its cable.
    speed
        of sim time, at most, of the wall clock's.
    """

    def __init__(
        self, costs: Costs, rovers: int, hosts: int, *, cores: int, speed: float = 1.0
    ) -> None:
        self._costs, self._rovers, self._hosts = costs, rovers, hosts
        self._period = TICK_SECONDS / speed
        self._loop = loop = Loop()
        self._first = Host(loop, cores)
        self._machines = [Host(loop, cores) for _ in range(hosts)] or [self._first]
        self._physics, self._router, self._gateway, self._node = (
            Process(self._first, role) for role in ("physics", "router", "gateway", "ROS node")
        )
        # All that is carried passes the cable of the first host, each way by itself.
        self._states, self._readings = (Cable(loop, CABLE_BYTES / costs.framing) for _ in range(2))
        self._sensors: list[tuple[int, Process, Process]] = []
        """Number of rovers, light sensors and scanners."""

        groups = min(rovers, hosts or cores)
        for group in range(groups):
            place = group * len(self._machines) // groups
            own = (group + 1) * rovers // groups - group * rovers // groups
            light, scanners = (
                Process(self._machines[place], role) for role in ("light sensors", "scanners")
            )
            self._sensors.append((own, light, scanners))
        self._reached = [[0, 0] for _ in self._sensors]
        """Tick that light sensors and scanners have finished."""

        self._ages: list[float] = []
        self._tick = 0

    def go(self) -> Prediction:
        """Simulate the run for `SECONDS` and return its prediction."""
        self._step()
        self._loop.run(SECONDS / 2)
        half = self._tick  # sensors are still getting behind before that, at no loss of speed
        self._loop.run(SECONDS)
        sim_seconds = self._tick * TICK_SECONDS
        factor = (self._tick - half) * TICK_SECONDS / (SECONDS / 2)
        busy: dict[str, float] = {}
        cores: dict[str, float] = {}
        late = []
        processes = [self._physics, self._router, self._gateway, self._node]
        for one in (*processes, *(one for _, *both in self._sensors for one in both)):
            busy[one.role] = max(busy.get(one.role, 0.0), one.busy_seconds / SECONDS)
            cores[one.role] = cores.get(one.role, 0.0) + one.busy_seconds / sim_seconds
            if one.behind_seconds > MOST_BEHIND_SECONDS:
                late.append(one.role)
        machines = {"first host": [self._first], "hosts of sensors": self._machines}
        for name, some in machines.items():
            busy[name] = max(one.busy_seconds / SECONDS / one.cores for one in some)
        carried = self._states.carried, self._readings.carried
        framing = self._costs.framing
        busy["cable"] = min(1.0, max(carried) * framing / SECONDS / CABLE_BYTES)
        ages = np.percentile(self._ages, [50, 99]) * 1e3 if self._ages else (math.inf, math.inf)
        return Prediction(
            *(self._rovers, self._hosts, factor, busy, cores),
            *(
                sum(carried) * framing / sim_seconds,
                (float(ages[0]), float(ages[1])),
                tuple({*late}),
            ),
        )

    def _step(self) -> None:
        """Step physics when the next tick is due and all sensors are near."""
        loop, tick = self._loop, self._tick
        due = tick * self._period
        if loop.now < due or tick - min(map(min, self._reached)) > WINDOW_TICKS:
            loop.at(max(due, loop.now + RETRY_SECONDS), self._step)
            return

        def stepped() -> None:
            self._tick += 1
            self._publish(tick, loop.now)
            self._step()

        self._physics.do(self._costs.tick + self._costs.tick_of_rover * self._rovers, stepped)

    def _publish(self, tick: int, now: float) -> None:
        """Pass a state to the sensors, and what else a tick brings."""
        costs, rovers = self._costs, self._rovers
        self._router.do(costs.router_tick + costs.router_of_rover * rovers)
        self._gateway.do(costs.gateway_tick)
        self._node.do(costs.node_tick)
        state_bytes = STATE_BYTES + OTHER_STATE_BYTES * rovers
        for (own, light, scanners), reached in zip(self._sensors, self._reached, strict=True):
            readings = own * (1 + (tick % ENCODER_TICKS == 0))
            work = costs.state + costs.state_of_other * rovers + costs.state_of_own * own
            sent = partial(self._finish, reached, 0, tick, readings, readings * IMU_BYTES, now)
            self._deliver(state_bytes, partial(light.do, work, sent))
            if tick % BATCH_TICKS == 0:
                scans = own * (tick % SCAN_TICKS == 0)
                work = costs.batch + costs.batch_of_other * rovers + costs.batch_of_own * own
                sent = partial(self._finish, reached, 1, tick, scans, scans * SCAN_BYTES, None)
                self._deliver(BATCH_TICKS * state_bytes, partial(scanners.do, work, sent))

    def _deliver(self, count: int, arrived: Callable[[], None]) -> None:
        """Pass states to a process of sensors."""
        if self._hosts:
            carry = partial(self._states.carry, count, arrived)
            self._router.do(self._costs.routed, carry)
        else:
            arrived()

    def _finish(
        self,
        reached: list[int],
        kind: int,
        tick: int,
        readings: int,
        count: int,
        since: float | None,
    ) -> None:
        """Note a tick that sensors have finished, and pass their readings on.

        Parameters
        ----------
        count
            bytes of the readings.
        since
            when their state was published; None: their age does not matter.
        """
        reached[kind] = tick
        if readings:
            self._forward(readings, count, since)

    def _forward(self, readings: int, count: int, since: float | None) -> None:
        """Pass readings to the gateway and to ROS."""

        def published() -> None:
            if since is not None:
                self._ages.append(self._loop.now - since)

        costs = self._costs
        to_ros = partial(self._node.do, readings * costs.reading_in_ros, published)
        to_gateway = partial(self._gateway.do, readings * costs.reading_to_ros, to_ros)
        if self._hosts:
            route = partial(self._router.do, readings * costs.routed, to_gateway)
            self._readings.carry(count, route)
        else:
            to_gateway()


ROLES = {
    "physics": "physics",
    "imu": "light sensors",
    "scanner": "scanners",
    "gateway": "gateway",
    "udp_bridge_ros2": "ROS node",
    "router": "router",
}
"""Processes of the model by role of `benchmarks.scale`."""


def on_enough_hosts(costs: Costs, rovers: int, *, cores: int) -> Prediction:
    """Return the run on so many hosts, a power of two, that the sensors are no bottleneck."""
    hosts = 0
    while True:
        outcome = Run(costs, rovers, hosts, cores=cores).go()
        is_short = outcome.bottleneck in ("light sensors", "scanners", "hosts of sensors")
        if outcome.holds or hosts >= rovers or (hosts and not is_short):
            return outcome
        hosts = 2 * hosts or 1


def most_rovers(holds: Callable[[int], bool], most: int = 4096) -> int:
    """Return the largest number of rovers with which a run holds."""
    low, high = 0, 1
    while high <= most and holds(high):
        low, high = high, 2 * high
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def percent(share: float) -> str:
    """Return a share as text."""
    return f"{100 * share:.0f} %"


def calibrate(one_host: Sequence[Mapping[str, Any]], several: Sequence[Mapping[str, Any]]) -> None:
    """Fit the costs, write them, and print the deviation of the model from the measurements.

    Parameters
    ----------
    one_host, several
        figures of `benchmarks.scale` and `benchmarks.scale.namespaces`.
    """
    costs = fitted(one_host, several)

    def model(row: Mapping[str, Any]) -> Prediction:
        hosts = row.get("hosts", 1)
        # Speeds of less than real time, at which nothing was left out.
        speed = min(1.0, row["real_time_factor"])
        return Run(costs, row["rovers"], hosts - 1, cores=2, speed=speed).go()

    cables = [row["cable_bytes"] / model(row).network_bytes for row in several if row["hosts"] > 1]
    costs = msgspec.structs.replace(costs, framing=float(np.mean(cables)))
    COSTS.write_bytes(msgspec.json.format(msgspec.json.encode(costs), indent=1) + b"\n")
    MEASURED.write_text(json.dumps(one_host, indent=1) + "\n", encoding="utf-8")
    print("| rovers | hosts | processor time: measured | model | on cables: measured | model |")
    print("|---|---|---|---|---|---|")
    for row in (*one_host, *several):
        found = model(row)
        here, there = sum(row["cores"].values()), sum(found.cores.values())
        cells = [str(row["rovers"]), str(row.get("hosts", 1)), percent(here), percent(there)]
        carried = row.get("cable_bytes", 0.0), found.network_bytes
        cells += [f"{count / 1e6:.1f} MB/s" if count else "" for count in carried]
        print(f"| {' | '.join(cells)} |")


def draw(costs: Costs, cores: int, measured: Sequence[Mapping[str, Any]], path: Path) -> None:
    """Draw how busy processes are by the number of rovers; dots are measured."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(8.4, 4.2), constrained_layout=True)
    counts = [1, 2, 4, 8, 16, 32, 64, 128, 256]
    # So slow that nothing is full.
    found = [Run(costs, count, 2, cores=cores, speed=0.05).go() for count in counts]
    single = {
        role: name for role, name in ROLES.items() if name not in ("light sensors", "scanners")
    }
    for role, name in single.items():
        (line,) = axes.plot(counts, [one.cores[name] for one in found], label=name)
        dots = [(row["rovers"], row["cores"][role]) for row in measured]
        axes.plot(*zip(*dots, strict=True), "o", color=line.get_color(), markersize=4)
    sensors = [one.cores["light sensors"] + one.cores["scanners"] for one in found]
    axes.plot(counts, sensors, "--", label="all sensors, on two hosts")
    axes.axhline(1.0, color="#c9302c", linewidth=1.0)
    axes.text(1.0, 1.1, "one core: the most that a process can take in real time", color="#c9302c")
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="rovers",
        ylabel="processor time for a second of sim time",
    )
    axes.grid(visible=True, which="both", alpha=0.3)
    axes.legend(loc="lower right")
    figure.savefig(path, dpi=110)
    pyplot.close(figure)


def main() -> int:
    """Model and print."""
    parser = argparse.ArgumentParser(prog="benchmarks.scale.model", description=__doc__)
    parser.add_argument("--rovers", default="32,100,1000", metavar="N,N", help="(%(default)s)")
    parser.add_argument("--cores", type=int, default=8, help="of each host (%(default)s)")
    parser.add_argument(
        "--calibrate",
        type=Path,
        nargs=2,
        metavar=("ONE_HOST.json", "HOSTS.json"),
        help="fit the costs to figures of benchmarks.scale and benchmarks.scale.namespaces",
    )
    parser.add_argument("--picture", type=Path, metavar="FILE.png", help="draw")
    options = parser.parse_args()
    if options.calibrate:
        one_host, several = (json.loads(file.read_bytes()) for file in options.calibrate)
        calibrate(one_host, several)
        return 0
    costs = msgspec.json.decode(COSTS.read_bytes(), type=Costs)
    if options.picture:
        draw(costs, options.cores, json.loads(MEASURED.read_bytes()), options.picture)
        return 0
    columns = (
        "physics",
        "router",
        "gateway",
        "ROS node",
        "light sensors",
        "hosts of sensors",
        "cable",
    )
    print("| rovers | hosts of sensors | speed | " + " | ".join(columns), end=" | ")
    print("IMU in ROS p50, p99 | limit |\n" + "|---" * (len(columns) + 5) + "|")
    for rovers in map(int, options.rovers.split(",")):
        one = on_enough_hosts(costs, rovers, cores=options.cores)
        cells = [str(rovers), str(one.hosts or "all on one"), f"{one.factor:.2f}"]
        cells += [percent(one.busy[column]) for column in columns]
        cells += [", ".join(f"{age:.1f} ms" for age in one.ages_ms)]
        print(f"| {' | '.join(cells)} | {'none' if one.holds else one.bottleneck} |", flush=True)
    for name, hosts, cores in (
        ("one host of 2 cores", 0, 2),
        *((f"1 + {more} of {options.cores}", more, options.cores) for more in (0, 2, 8)),
    ):
        most = most_rovers(lambda count, h=hosts, c=cores: Run(costs, count, h, cores=c).go().holds)  # type: ignore[misc]
        after = Run(costs, most + 1, hosts, cores=cores).go()
        print(f"{name}: at most {most} rovers in real time; then the limit is: {after.bottleneck}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
