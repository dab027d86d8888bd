# SPDX-License-Identifier: Apache-2.0
"""The physics process: steps the world, tells everybody its state, serves what replicas need.

Rule: the only process that reads the scenario's files and the only one that says what tick it is.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Sequence

from groundlink.bus.core_topics import PHYSICS
from groundlink.bus.session import DEFAULT_ENDPOINT, Bus
from groundlink.core.extras import process_needs
from groundlink.process import runner as process
from groundlink.process.joining import Heartbeat
from groundlink.process.name_claim import claim_name

with process_needs(PHYSICS, "physics"):
    from services.physics.run.server import PhysicsServer
    from services.physics.run.source import add_arguments, source

NAME = PHYSICS


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
        help="a process without which the run does not begin, such as recorder; repeatable",
    )
    options = parser.parse_args(arguments)
    scenario, saved, followed = source(options)
    run = options.run or scenario.name
    router = process.router_of(options)
    listen = options.listen or (None if router else DEFAULT_ENDPOINT)
    with Bus(connect=router, listen=listen, name=NAME) as bus:
        claim = claim_name(bus, run, NAME)
        physics = PhysicsServer(
            *(scenario, run, bus), saved=saved, followed=followed, others=options.wait_for
        )
        heartbeat = Heartbeat(bus, run, NAME, claim)
        try:
            _keep_stepping(physics, heartbeat, stop.is_set)
        finally:
            # Reports are made of what was heard last.
            heartbeat.beat(physics.episode.tick, physics.counters(time.monotonic()))
            physics.close()


def _keep_stepping(
    physics: PhysicsServer, heartbeat: Heartbeat, stopped: Callable[[], bool]
) -> None:
    """Step whenever the pace and people allow it, and say who else does not.

    Raises
    ------
    RunFailed
        when the scenario has the run end rather than go on like this.
    """
    while not stopped():
        now = time.monotonic()
        if heartbeat.due():
            heartbeat.beat(physics.episode.tick, physics.counters(now))
        physics.hear()
        wait = physics.wait_seconds(now)
        for line in physics.told(now):
            print(f"{NAME}: {line}", file=sys.stderr, flush=True)
        if wait == 0.0:
            physics.step()
        else:
            physics.rest(min(wait, 0.05))


if __name__ == "__main__":
    process.run(NAME, main)
