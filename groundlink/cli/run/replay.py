# SPDX-License-Identifier: Apache-2.0
"""`groundlink replay RUN.mcap`: a recorded run to ROS again, through a gateway of its own.

Rule: starts the replay where `up` starts physics and sensors; the gateway and the ROS side are the
same. What is in the file is the replay's business.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from groundlink.bus.core_topics import REPLAY
from groundlink.cli.run.dashboard import dashboard
from groundlink.cli.terminal import output as terminal
from groundlink.core.extras import needs
from groundlink.loader import load
from groundlink.monitor.supervisor import Child

from . import running, supervised

START_SECONDS = 3.0
"""What a ROS node may take to start and be found."""

DRAIN_SECONDS = 2.0
"""After the last message, until what became of it is known."""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("replay", help="send a recorded run to ROS again")
    parser.add_argument("recording", metavar="RUN.mcap", help="file that was recorded")
    parser.add_argument("--factor", type=float, default=1.0, metavar="F", help="times real time")
    parser.add_argument(
        "--from", type=float, default=0.0, metavar="S", dest="start", help="begin S s into the run"
    )
    parser.add_argument("--loop", action="store_true", help="begin anew at the end, until Ctrl-C")
    parser.add_argument("--run", help="name of the run (default: as recorded)")
    parser.add_argument(
        "--gateway",
        metavar="SCENARIO",
        help="take addresses, link and key from this scenario's `gateway` instead of the recorded",
    )
    parser.add_argument(
        "--listen", metavar="ENDPOINT", default=running.LISTEN_DEFAULT, help=running.LISTEN_HELP
    )
    parser.add_argument(
        "--no-ros", action="store_true", help="start nothing on the ROS side; it runs elsewhere"
    )
    parser.add_argument(
        "--no-gateway", action="store_true", help="on the bus alone, for viewers and recorders"
    )
    parser.set_defaults(command=replay)


def replay(options: argparse.Namespace) -> int:
    """Replay a recording; 0 when everything that was declared arrived at its rate."""
    with needs("record"):
        from groundlink.recording.reader import Recording

    with Recording(Path(options.recording)) as recording:
        recorded = recording.run
    scenario = recorded.scenario
    gateway = load(options.gateway).gateway if options.gateway else scenario.gateway
    run = options.run or recorded.run
    console = terminal.console()
    join = running.joining(run, options.listen)
    commands = {REPLAY: ["-m", "services.replay", options.recording, *join]}
    commands[REPLAY] += ["--factor", repr(options.factor), "--from", repr(options.start)]
    commands[REPLAY] += ["--loop"] if options.loop else []
    commands[REPLAY] += ["--gateway", options.gateway] if options.gateway else []
    if not options.no_gateway:
        commands["gateway"] = ["-m", "services.gateway", *join]
        commands[REPLAY] += ["--wait-for", "gateway"]
        if not options.no_ros:
            commands[running.ROS_SIDE] = running.ros_side(gateway, console)
            commands[REPLAY] += ["--delay", repr(START_SECONDS)]
    supervised_run = supervised.SupervisedRun(
        commands, run, options.listen, console, finite={REPLAY}
    )
    monitor, children = supervised_run.monitor, supervised_run.children
    title = f"{options.recording} ({scenario.name}, run `{run}`)"
    failed = supervised_run.go(
        _Drained(children[REPLAY]).is_over, lambda: dashboard(title, monitor, children.values())
    )
    if failed:
        return supervised.exit_code(failed)
    console.print(dashboard("summary", monitor, children.values()))
    # In a loop stamps jump back, and counted in stamps there is no rate.
    if options.loop or options.no_gateway or (options.no_ros and not monitor.streams):
        return 0
    faults = monitor.faults(needs_reports=not options.no_ros)
    for fault in faults:
        terminal.say(console, f"not kept: {fault}")
    return 1 if faults else 0


class _Drained:
    """Over a while after the replay has ended."""

    def __init__(self, replay: Child) -> None:
        self._replay = replay
        self._until: float | None = None

    def is_over(self) -> bool:
        if self._until is None and self._replay.is_done:
            self._until = time.monotonic() + DRAIN_SECONDS
        return self._until is not None and time.monotonic() >= self._until
