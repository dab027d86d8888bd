# SPDX-License-Identifier: Apache-2.0
"""`groundlink replay RUN.mcap`: send a recorded run to ROS through a gateway.

Like `up`, with the replay process in place of physics and sensors.
"""

import argparse
import time
from pathlib import Path

from groundlink.bus.core_topics import REPLAY
from groundlink.cli import Subparsers
from groundlink.cli.run.dashboard import dashboard
from groundlink.cli.terminal import output as terminal
from groundlink.cli.terminal.json_output import add_json_option, print_json
from groundlink.core.extras import needs
from groundlink.loader import load
from groundlink.monitor import process_commands
from groundlink.monitor.supervisor import Child

from . import running, supervised

START_SECONDS = 3.0
"""Time for a ROS node to start and be discovered."""

DRAIN_SECONDS = 2.0
"""Time after the last message for delivery reports to arrive."""


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("replay", help="send a recorded run to ROS")
    parser.add_argument("recording", metavar="RUN.mcap", help="file that was recorded")
    parser.add_argument(
        "--factor",
        type=float,
        default=1.0,
        metavar="F",
        help="speed relative to real time (%(default)g)",
    )
    parser.add_argument(
        "--from",
        type=float,
        default=0.0,
        metavar="S",
        dest="start",
        help="start S seconds into the run",
    )
    parser.add_argument("--loop", action="store_true", help="repeat until Ctrl-C")
    running.add_arguments(parser, "recorded name")
    add_json_option(parser, "print a report of the replay as JSON; tables go to stderr")
    parser.add_argument(
        "--gateway",
        metavar="SCENARIO",
        help="use the `gateway` section of this scenario instead of the recorded one",
    )
    parser.add_argument(
        "--no-gateway",
        action="store_true",
        help="publish on the bus only, for viewers and recorders",
    )
    parser.set_defaults(command=replay)


def replay(options: argparse.Namespace) -> int:
    """Replay a recording; return 0 if every stream arrived at its declared rate."""
    with needs("record"):
        from groundlink.recording.reader import Recording

    with Recording(Path(options.recording)) as recording:
        recorded = recording.run
    scenario = recorded.scenario
    gateway = load(options.gateway).gateway if options.gateway else scenario.gateway
    run = options.run or recorded.run
    console = terminal.console(stderr=options.json)
    join = process_commands.joining(run, options.listen)
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
    started = time.time()
    failed = supervised_run.go(
        _Drained(children[REPLAY]).is_over, lambda: dashboard(title, monitor, children.values())
    )
    if failed:
        return supervised.exit_code(failed)
    console.print(dashboard("summary", monitor, children.values()))
    faults = []
    # In a loop stamps jump back, so rates by stamps are undefined.
    if not (options.loop or options.no_gateway or (options.no_ros and not monitor.streams)):
        faults = monitor.faults(needs_reports=not options.no_ros)
    if options.json:
        print_json(supervised_run.report(scenario, started, faults))
    for fault in faults:
        terminal.say(console, f"failed: {fault}")
    return 1 if faults else 0


class _Drained:
    """End condition: `DRAIN_SECONDS` after the replay has ended."""

    def __init__(self, replay: Child) -> None:
        self._replay = replay
        self._until: float | None = None

    def is_over(self) -> bool:
        if self._until is None and self._replay.is_done:
            self._until = time.monotonic() + DRAIN_SECONDS
        return self._until is not None and time.monotonic() >= self._until
