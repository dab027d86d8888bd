# SPDX-License-Identifier: Apache-2.0
"""How much faster than real time physics runs: `python -m benchmarks.physics`.

Measures each tick of the physics process in `fast` mode without sensors to wait for: a command to
each vehicle 20 times a second, the step, and all publishing on a real bus with one subscriber. Time
is processor time of all threads of this process, so the figures hold for one core whatever else
runs.
"""

import argparse
import multiprocessing
import multiprocessing.connection
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from math import sin
from pathlib import Path

import numpy as np

from groundlink.bus.core_topics import STATE
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.core.clock import TICK_NANOS, TICK_RATE_HZ, TICK_SECONDS
from groundlink.loader import load
from groundlink.messages.base import BusMessage, Command, State, encode
from groundlink.monitor.process_commands import free_endpoint
from groundlink.scenario import Scenario
from services.physics.run.episode import Episode
from services.physics.run.publishers import BusPublishers, Publishers

from .claims import Claim, add_options, judge

RUN = "benchmark"
ROUNDS = 5
SECONDS = 1.0
"""Sim time of a round."""

COMMAND_TICKS = TICK_RATE_HZ // 20

LEAST = {
    ("rover", 1, ""): 60.0,
    ("rover", 4, ""): 20.0,
    ("rover", 10, ""): 10.0,
    ("rover", 16, ""): 8.0,
    ("tank", 1, ""): 25.0,
    ("tank", 4, ""): 9.0,
    ("tank", 16, ""): 2.7,
    ("rover", 1, "dry_sand"): 35.0,
    ("tank", 1, "clayey_soil_55"): 9.0,
}
"""Ratios to real time below which `--check` fails, by model, number of vehicles and soil."""

APART_M = 12.0


def field(model: str, count: int, soil: str = "") -> Scenario:
    """Return a scenario of vehicles that drive about far from each other.

    On a flat floor, or on terrain of soil, in which they leave ruts.
    """
    floor = (
        "  terrain: {kind: hills, size_m: [400, 400], cell_m: 1.0, height_m: 1.0, longest_m: 80.0,"
        " material: ground}"
        if soil
        else "  solids: [{name: floor, shape: {kind: box, size_m: [400, 400, 1]}, material: ground,"
        " position_m: [0, 0, -0.5]}]"
    )
    lines = [
        "name: field",
        "time: {mode: fast}",
        "world:",
        "  name: field",
        "  materials:",
        f"    ground: {{{f'soil: {soil}' if soil else ''}}}",
        *(f"    {name}: {{}}" for name in ("rubber", "metal", "dark_metal")),
        "    yellow_paint: {}",
        floor,
        "vehicles:",
    ]
    for i in range(count):
        x, y = APART_M * (i % 4), APART_M * (i // 4)
        lines.append(f"  - {{name: v{i}, model: {model}, placement: {{x_m: {x}, y_m: {y}}}}}")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "field.yaml")
        file.write_text("\n".join(lines))
        return load(file)


def encoding_only(scenario: Scenario) -> Publishers:
    """Return publishers that encode messages and send nothing."""

    def each() -> dict[str, Callable[[BusMessage], bytes]]:
        return {vehicle.name: encode for vehicle in scenario.vehicles}

    return Publishers(encode, encode, encode, encode, each(), each(), each(), each())


def tick_us(scenario: Scenario, publishers: Publishers) -> float:
    """Return processor time per tick: the median of some rounds, after one to warm up."""
    episode = Episode(scenario, RUN, publishers, required=(), wall_nanos=0)
    episode.begin(0, 0.0)
    rounds = []
    ticks = round(SECONDS / TICK_SECONDS)
    for _ in range(ROUNDS + 1):
        started = time.process_time()
        for _ in range(ticks):
            if episode.tick % COMMAND_TICKS == 0:
                swing = sin(episode.tick / TICK_RATE_HZ)
                stamp = episode.epoch_nanos + episode.tick * TICK_NANOS
                for vehicle in scenario.vehicles:
                    asked = Command(stamp, (0.5 * swing, 0.0, 0.0), (0.0, 0.0, swing))
                    episode.command(vehicle.name, asked)
            episode.step()
        rounds.append((time.process_time() - started) / ticks * 1e6)
    episode.end()
    return statistics.median(rounds[1:])


def listen(endpoint: str, key: str, pipe: multiprocessing.connection.Connection) -> None:
    """Receive states as a sensor does until the pipe says to end; send their count."""
    inbox: BusInbox[State] = BusInbox(depth=1024)
    with Bus(connect=endpoint) as bus:
        bus.subscribe(key, State, inbox)
        pipe.send("ready")
        count = 0
        while not pipe.poll():
            count += inbox.get(seconds=0.1) is not None
    pipe.send(count)


def main() -> int:
    """Measure, print, and with --check compare."""
    parser = argparse.ArgumentParser(prog="benchmarks.physics", description=__doc__)
    add_options(parser)
    options = parser.parse_args()
    endpoint = free_endpoint()
    here, there = multiprocessing.Pipe()
    claims: list[Claim] = []
    costs: dict[str, list[tuple[int, float]]] = {}
    with Bus(listen=endpoint) as bus:
        listener = multiprocessing.get_context("spawn").Process(
            target=listen, args=(endpoint, STATE.key_in(RUN), there), daemon=True
        )
        listener.start()
        if here.recv() != "ready":
            raise RuntimeError("the listener did not start")
        for (model, count, soil), least in LEAST.items():
            scenario = field(model, count, soil)
            bare = tick_us(scenario, encoding_only(scenario))
            cost = tick_us(scenario, BusPublishers(bus, RUN, scenario))
            ratio = 1e6 * TICK_SECONDS / cost
            name = f"{model} on {soil}" if soil else model
            costs.setdefault(name, []).append((count, cost))
            print(
                f"{count:2d} x {name:22s} {cost:6.0f} us a tick, {ratio:5.1f} x real time; "
                f"unpublished {bare:6.0f} us",
                flush=True,
            )
            claims.append(Claim(f"physics of {count} x {name}, x real time", ratio, least))
        here.send("end")
        print(f"a listening process took {here.recv()} states")
    for model, points in costs.items():
        if len(points) == 1:
            continue
        counts, times = np.array(points, np.float64).T
        each, fixed = np.polyfit(counts, times, 1)
        off = np.abs(each * counts + fixed - times).max()
        print(f"{model}: {fixed:.0f} us + {each:.0f} us for each, to within {off:.0f} us")
    return judge(claims, options)


if __name__ == "__main__":
    sys.exit(main())
