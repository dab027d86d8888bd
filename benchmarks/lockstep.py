# SPDX-License-Identifier: Apache-2.0
"""Speed of a run in lockstep, and the cost of its waiting: `python -m benchmarks.lockstep`.

Runs what `groundlink up` starts for the default scenario in fast mode, first without and then with
its camera, and a plain receiver in the place of ROS. One run has many episodes, each from a reset
to the slowest process's acknowledgement of the last tick. Every other episode is free: with the
same processes and states, but physics waits for acknowledgements only before the last tick. A loss
in any episode fails the benchmark. Time counts from the first acknowledgement of an episode: worlds
are built before it. The router is in this process, whose processor time counts as the router's.
"""

import argparse
import itertools
import json
import socket
import statistics
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import yaml

from groundlink.bus.control_client import send_command
from groundlink.bus.core_topics import ACK, HEALTH
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.cli.run import running
from groundlink.core.clock import TICK_SECONDS
from groundlink.episode.control import Reset
from groundlink.loader import load
from groundlink.messages.base import Ack, BusMessage, Health
from groundlink.monitor import process_commands
from groundlink.monitor.supervisor import Supervisor
from groundlink.process import runner as process
from groundlink.scenario import Scenario

from .claims import Claim, add_options, judge
from .recording import processor_seconds

DEFAULT = Path(__file__).parents[1] / "scenarios" / "indoor_lab.yaml"
RUN = "benchmark"
TICKS = 2000
"""Ticks of an episode: 5 s. A sensor buffers 4,096 states and the gateway as many messages; 600 of
these come in a second: none is lost in a free episode."""

PAIRS = 7
LEAST_FACTOR = {"without": 9.0, "with": 7.0}
"""Times real time, without and with the camera."""

MOST_COST = 0.1
LOST = ("missed_ticks", "bus_dropped", "gap_overloaded")
"""Counters that must be 0."""


class EpisodeCost(NamedTuple):
    """An episode: wall time, and processor time by process, s."""

    seconds: float
    processor: dict[str, float]


def scenario_file(folder: Path, camera: str) -> Path:
    """Write the scenario into a folder, `with` or `without` its camera."""
    document = yaml.safe_load(DEFAULT.read_text(encoding="utf-8"))
    for vehicle in document["vehicles"] if camera == "without" else ():
        vehicle["sensors"] = [s for s in vehicle["sensors"] if s["kind"] != "camera"]
    document["time"] = {"mode": "fast", "epoch": "zero"}
    bind, peer = (f"127.0.0.1:{free_port()}" for _ in range(2))
    document["gateway"] = {"bind": bind, "peer": peer}
    file = folder / "lockstep.yaml"
    file.write_text(json.dumps(document), encoding="utf-8")
    return file


def free_port() -> int:
    """Return a free UDP port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def physics() -> None:
    """Run the physics process; every other episode is free."""
    from services.physics import __main__
    from services.physics.run import episode as episodes
    from services.physics.run import pacer
    from services.physics.run.participants import Allowance

    round_number = itertools.count()
    original = pacer.pacer_for

    def pacer_of_episode(
        scenario: Scenario, episode: int, required: Sequence[str]
    ) -> pacer.StepPacer:
        free = next(round_number) % 2

        def window(ticks: int) -> Allowance:
            def allowed(reached: int) -> int:
                if reached >= TICKS:
                    return reached + ticks
                return TICKS if free else min(reached + ticks, TICKS)

            return allowed

        pacer.window = window  # type: ignore[attr-defined]
        return original(scenario, episode, required)

    episodes.pacer_for = pacer_of_episode  # type: ignore[attr-defined]
    process.run(__main__.NAME, __main__.main)


def measured_episode(
    acks: BusInbox[Ack], needed: set[str], after: int, supervisor: Supervisor
) -> tuple[int, EpisodeCost]:
    """Return the next episode, measured from its first acknowledgement to the last ones."""
    reached: dict[str, int] = {}
    episode = after
    while len(reached) < len(needed) or min(reached.values()) < TICKS:
        arrived = acks.get(seconds=30)
        if arrived is None:
            raise RuntimeError(f"no acknowledgement for 30 s; last ones: {reached}")
        name, ack = arrived[0].partition("/ack/")[2], arrived[1]
        if ack.episode > episode:
            episode, reached = ack.episode, {}
            begun, before = time.monotonic(), processor_times(supervisor)
        if episode > after and ack.episode == episode and name in needed:
            reached[name] = ack.tick
    seconds, now = time.monotonic() - begun, processor_times(supervisor)
    return episode, EpisodeCost(seconds, {name: now[name] - before.get(name, 0.0) for name in now})


def lost(health: BusInbox[BusMessage]) -> dict[str, int]:
    """Return losses that processes have counted."""
    found: dict[str, int] = {}
    while len(health) and (arrived := health.get(seconds=0)):
        message = arrived[1]
        assert isinstance(message, Health)
        for what in LOST:
            if count := message.counters.get(what):
                found[f"{message.process} {what}"] = count
    return found


def processor_times(supervisor: Supervisor) -> dict[str, float]:
    """Return the processor time of each process so far, s."""
    children = {name: child.pid for name, child in supervisor.children.items() if child.pid}
    return {name: processor_seconds(pid) for name, pid in children.items()} | {
        "router": time.process_time()
    }


def measure(scenario: Scenario, file: Path, pairs: int, together: bool) -> list[list[EpisodeCost]]:
    """Return pairs of episodes, one in lockstep and one free."""
    endpoint = process_commands.free_endpoint()
    commands = process_commands.commands(
        scenario, str(file), RUN, endpoint, sensors_together=together
    )
    commands["physics"][:2] = ["-m", "benchmarks.lockstep", "physics"]
    receiver = ("-m", "udp_bridge", "listen", "--bind", scenario.gateway.peer, "--quiet")
    supervisor = Supervisor({**commands, running.ROS_SIDE: receiver}, lambda *said: print(*said))
    needed = {*scenario.sensor_names(), "gateway"}
    acks: BusInbox[Ack] = BusInbox(depth=100_000)
    health: BusInbox[BusMessage] = BusInbox(depth=10_000)
    with Bus(listen=endpoint) as bus:
        bus.subscribe(ACK.key_in(RUN), Ack, acks)
        bus.subscribe(HEALTH.key_in(RUN), Health, health)
        supervisor.start()
        try:
            episode, _ = measured_episode(acks, needed, -1, supervisor)
            measured = []
            for _ in range(1 + 2 * pairs):
                send_command(bus, RUN, Reset())
                episode, taken = measured_episode(acks, needed, episode, supervisor)
                measured.append(taken)
        finally:
            supervisor.stop()
    if found := lost(health):
        raise RuntimeError(f"lost: {found}; episodes cannot be compared")
    # The first two episodes warm up.
    return [measured[i : i + 2] for i in range(1, 1 + 2 * pairs, 2)]


def main() -> int:
    """Measure, print, and with --check compare."""
    parser = argparse.ArgumentParser(prog="benchmarks.lockstep", description=__doc__)
    parser.add_argument("--pairs", type=int, default=PAIRS, help="of episodes (%(default)s)")
    parser.add_argument(
        "--sensors-together", action="store_true", help="all sensors in one process"
    )
    add_options(parser)
    options = parser.parse_args()
    claims = []
    for camera, least in list(LEAST_FACTOR.items()):
        with tempfile.TemporaryDirectory() as folder:
            file = scenario_file(Path(folder), camera)
            pairs = measure(load(str(file)), file, options.pairs, options.sensors_together)
        claims += report(camera, least, pairs)
    return judge(claims, options)


def report(camera: str, least: float, pairs: Sequence[Sequence[EpisodeCost]]) -> list[Claim]:
    """Print the measurements; return the claims about them."""
    sim_seconds = TICKS * TICK_SECONDS
    what = f"default scenario {camera} its camera"
    print(what)
    for held, free in pairs:
        factors = (sim_seconds / each.seconds for each in (held, free))
        print("{:5.1f} x real time in lockstep, {:5.1f} free".format(*factors))
    for kind, episodes in zip(("lockstep", "free"), zip(*pairs, strict=True), strict=True):
        shares = {
            name: statistics.median(each.processor[name] for each in episodes) / sim_seconds
            for name in episodes[0].processor
        }
        each = ", ".join(f"{name} {1e3 * share:.0f}" for name, share in shares.items())
        total = 1e3 * sum(shares.values())
        print(f"{kind}: {total:.0f} ms of processor time a second of sim time ({each})")
    factor = sim_seconds / statistics.median(held.seconds for held, _ in pairs)
    cost = statistics.median(held.seconds / free.seconds for held, free in pairs) - 1
    return [
        Claim(f"{what} in lockstep, x real time", factor, least),
        Claim(f"{what}: time that lockstep adds to a free run", cost, MOST_COST, False),
    ]


if __name__ == "__main__":
    if sys.argv[1:2] == ["physics"]:
        del sys.argv[1]
        physics()
    else:
        sys.exit(main())
