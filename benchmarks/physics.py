# SPDX-License-Identifier: Apache-2.0
"""How much faster than real time physics runs: `python -m benchmarks.physics`.

Rule: what is timed is what the physics process does in each tick of `fast` mode when no sensor is
waited for: a command 20 times a second, the step, the state of every vehicle, its bytes, and
putting them on a real bus that one other process listens to. The same without the bus tells what
that costs.
"""

from __future__ import annotations

import argparse
import multiprocessing
import multiprocessing.connection
import socket
import statistics
import sys
import time
from collections.abc import Callable
from math import sin
from pathlib import Path

from groundlink.bus import Bus
from groundlink.clock import TICK_RATE_HZ, TICK_SECONDS
from groundlink.inbox import Inbox
from groundlink.messages import Command, Message, State, encode
from groundlink.scenario import Scenario, load
from groundlink.topics import STATE
from groundlink.world.build import solids, world_hash
from services.physics.simulation import Simulation

LAB = Path(__file__).parents[1] / "scenarios" / "indoor_lab.yaml"
RUN = "benchmark"
ROUNDS = 7
SECONDS = 5.0
"""Of sim time in a round."""

COMMAND_TICKS = TICK_RATE_HZ // 20


def round_ratio(
    simulation: Simulation, name: str, digest: str, publish: Callable[[Message], bytes]
) -> float:
    """Drive a rover about for a round and return sim seconds per wall second."""
    started = time.perf_counter()
    for _ in range(round(SECONDS / TICK_SECONDS)):
        if simulation.tick % COMMAND_TICKS == 0:
            swing = sin(simulation.tick / TICK_RATE_HZ)
            command = Command(simulation.sim_nanos, (0.5 * swing, 0.0, 0.0), (0.0, 0.0, swing))
            simulation.command(name, command)
        simulation.step()
        publish(
            State(
                RUN, 0, simulation.tick, simulation.sim_nanos, digest, simulation.vehicle_states()
            )
        )
    return SECONDS / (time.perf_counter() - started)


def measure(scenario: Scenario, publish: Callable[[Message], bytes]) -> float:
    """Return the median ratio of some rounds, after one to warm up."""
    digest, name = world_hash(scenario), scenario.vehicles[0].name
    with Simulation(scenario, solids(scenario)) as simulation:
        ratios = [round_ratio(simulation, name, digest, publish) for _ in range(ROUNDS + 1)]
    return statistics.median(ratios[1:])


def listen(endpoint: str, key: str, pipe: multiprocessing.connection.Connection) -> None:
    """Take states off the bus, as a sensor does, until told to end; say how many came."""
    inbox: Inbox[State] = Inbox(depth=1024)
    with Bus(connect=endpoint) as bus:
        bus.subscribe(key, State, inbox)
        pipe.send("ready")
        count = 0
        while not pipe.poll():
            count += inbox.get(seconds=0.1) is not None
    pipe.send(count)


def with_bus(scenario: Scenario) -> tuple[float, int]:
    """Return the ratio with publishing, and how many states a listening process took."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        endpoint = f"tcp/127.0.0.1:{free.getsockname()[1]}"
    key = STATE.key_in(RUN)
    here, there = multiprocessing.Pipe()
    with Bus(listen=endpoint) as bus:
        publish = bus.publisher(key, STATE.delivery)
        context = multiprocessing.get_context("spawn")
        listener = context.Process(target=listen, args=(endpoint, key, there), daemon=True)
        listener.start()
        if here.recv() != "ready":
            raise RuntimeError("the listener did not start")
        ratio = measure(scenario, publish)
        here.send("end")
        return ratio, here.recv()


def main() -> int:
    """Measure, print, and with --check compare."""
    parser = argparse.ArgumentParser(prog="benchmarks.physics", description=__doc__)
    parser.add_argument("--check", type=float, metavar="RATIO", help="fail below this ratio")
    options = parser.parse_args()
    scenario = load(LAB)
    bare = measure(scenario, encode)
    print(f"solids in the world:          {len(solids(scenario))}")
    print(f"step, state and its bytes:    {bare:6.1f} x real time, {2500 / bare:5.1f} us a tick")
    ratio, taken = with_bus(scenario)
    print(f"with publishing:              {ratio:6.1f} x real time, {2500 / ratio:5.1f} us a tick")
    ticks = round((ROUNDS + 1) * SECONDS / TICK_SECONDS)
    print(f"taken by a listening process: {taken} of {ticks} states")
    if options.check is not None and ratio < options.check:
        print(f"expected at least {options.check:g} x real time", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
