# SPDX-License-Identifier: Apache-2.0
"""The physics process: steps the world, publishes its state and serves the other processes.

It alone reads the scenario's files, and it alone decides when time advances.
"""

import sys
import threading
import time
from collections.abc import Callable, Sequence

from groundlink.bus.core_topics import PHYSICS
from groundlink.bus.session import Bus
from groundlink.bus.zenoh_config import DEFAULT_ENDPOINT
from groundlink.core.extras import process_needs
from groundlink.process import runner as process
from groundlink.process.joining import Heartbeat
from groundlink.process.name_claim import claim_name

with process_needs(PHYSICS, "physics"):
    from services.physics.run.server import PhysicsServer
    from services.physics.run.source import add_arguments, source_of

NAME = PHYSICS

LONGEST_WAIT_SECONDS = 0.05


def main(arguments: Sequence[str], stop: threading.Event) -> None:
    """Run physics until `stop` is set."""
    parser = process.parser(NAME, "Simulate a scenario's world and vehicles.")
    add_arguments(parser)
    parser.add_argument(
        "--listen",
        metavar="ENDPOINT",
        help=f"be the router that others connect to (default {DEFAULT_ENDPOINT} without --connect)",
    )
    parser.add_argument(
        "--wait-for",
        metavar="PROCESS",
        action="append",
        default=[],
        help="wait for this process before the run begins, such as recorder; repeatable",
    )
    parser.add_argument("--paused", action="store_true", help="pause the run before its first step")
    options = parser.parse_args(arguments)
    source = source_of(options)
    run = options.run or source.scenario.name
    router = process.router_of(options)
    listen = options.listen or (None if router else DEFAULT_ENDPOINT)
    with Bus(connect=router, listen=listen, name=NAME) as bus:
        claim = claim_name(bus, run, NAME)
        physics = PhysicsServer(source, run, bus, required=options.wait_for)
        heartbeat = Heartbeat(bus, run, NAME, claim)
        if options.paused:
            physics.control.pause()
        try:
            _step_until(stop.is_set, physics, heartbeat)
        finally:
            # Reports show the last health message.
            heartbeat.beat(physics.episode.tick, physics.counters(time.monotonic()))
            physics.close()


def _step_until(stopped: Callable[[], bool], physics: PhysicsServer, heartbeat: Heartbeat) -> None:
    """Step whenever the pacer and the run's control allow it.

    Raises
    ------
    RunFailed
        when the scenario's policy ends the run.
    """
    while not stopped():
        now = time.monotonic()
        if heartbeat.due():
            heartbeat.beat(physics.episode.tick, physics.counters(now))
        physics.receive()
        wait = physics.wait_seconds(now)
        for line in physics.log_lines(now):
            print(f"{NAME}: {line}", file=sys.stderr, flush=True)
        if wait == 0.0:
            physics.step()
        else:
            physics.wait(min(wait, LONGEST_WAIT_SECONDS))


if __name__ == "__main__":
    process.run(NAME, main)
