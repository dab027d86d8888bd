# SPDX-License-Identifier: Apache-2.0
"""`groundlink record SCENARIO --out RUN.mcap`: record a run as fast as this machine allows.

Starts physics, sensors, drivers and the recorder, without ROS. The summary is read from the file.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from groundlink.bus.topics import driver_names
from groundlink.cli import Subparsers
from groundlink.cli.expectations.output import (
    add_junit_option,
    check_junit,
    expectations_table,
    summary,
    write_junit,
)
from groundlink.cli.terminal import output as terminal
from groundlink.cli.terminal.json_output import add_json_option, print_json
from groundlink.cli.terminal.progress import progress
from groundlink.cli.terminal.tables import Column, FittingTable
from groundlink.core.atomic_file import check_new_file
from groundlink.core.errors import UserError
from groundlink.core.extras import needs
from groundlink.episode.mission import Mission
from groundlink.expectations.results import problems
from groundlink.loader import overrides
from groundlink.messages.base import Health
from groundlink.monitor import process_commands
from groundlink.monitor.mission_monitor import MissionMonitor
from groundlink.monitor.run_monitor import RATE_TOLERANCE, RunMonitor
from groundlink.monitor.supervisor import end_with_parent

from . import running, supervised
from .dashboard import missions_table

if TYPE_CHECKING:
    from groundlink.recording.metadata import TopicFacts

SECONDS = 30.0
"""Default duration, sim time."""


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "record", help="record a run of a scenario to a file, without ROS"
    )
    parser.add_argument("scenario", help=running.SCENARIO_HELP)
    parser.add_argument("--out", required=True, metavar="RUN.mcap", help="file to write")
    parser.add_argument(
        "--duration",
        type=float,
        default=SECONDS,
        metavar="S",
        help="sim time to record (default %(default)g s)",
    )
    parser.add_argument(
        "--realtime", action="store_true", help="run in real time instead of as fast as possible"
    )
    parser.add_argument(
        "--checkpoints",
        type=float,
        metavar="S",
        help="make a checkpoint every S seconds of sim time, for `groundlink seek`",
    )
    parser.add_argument(
        "--over-link",
        action="store_true",
        help="record what ROS would receive over the scenario's emulated link, in virtual time",
    )
    running.add_arguments(parser, "scenario's", ros=False)
    overrides.add_argument(parser)
    add_json_option(parser)
    add_junit_option(parser)
    parser.set_defaults(command=record)


def record(options: argparse.Namespace) -> int:
    """Record a run; return 0 if it went as it should.

    The file has every declared rate, no vehicle ended badly, and every expectation passed.
    """
    if options.checkpoints is not None:
        options.set = [*options.set, f"time.checkpoint_s={options.checkpoints}"]
    changes = overrides.field_changes(options.set)
    scenario = running.load_scenario(options.scenario, changes)
    out = Path(options.out)
    if not options.duration > 0:
        raise UserError(f"--duration {options.duration:g}: expected seconds, more than 0")
    if options.over_link and scenario.gateway.link is None:
        raise UserError(
            f"--over-link: {options.scenario} has no emulated link. Fix: add --set "
            "'gateway.link={}'"
        )
    check_new_file("--out", out)
    check_junit(options)
    run = options.run or scenario.name
    console = terminal.console(stderr=options.json)
    commands = process_commands.commands(scenario, options.scenario, run, options.listen)
    del commands["gateway"]
    commands["physics"] += ["--mode", "realtime" if options.realtime else "fast"]
    commands["physics"] += ["--lockstep", "sensors"]  # no ROS node takes part
    commands["physics"] += overrides.forwarded(options)
    commands[running.RECORDER] = [
        *process_commands.recorder(options.out, run, options.listen),
        *("--duration", f"{options.duration:g}"),
        *(() if options.realtime else ("--ordered",)),
    ]
    for name in (*scenario.sensor_names(), *driver_names(scenario), running.RECORDER):
        commands["physics"] += ["--wait-for", name]
    supervised_run = supervised.SupervisedRun(
        *(commands, run, options.listen, console),
        finite={running.RECORDER},
        missions=MissionMonitor(scenario, until_seconds=options.duration),
    )
    recorder, monitor = supervised_run.children[running.RECORDER], supervised_run.monitor

    def done(health: Health) -> tuple[float, str]:
        return monitor.sim_seconds, f", {health.counters['bytes'] / 1e6:.1f} MB"

    shown = supervised.RecorderProgress(monitor, options.duration, done)
    failed = supervised_run.go(lambda: recorder.is_done, lambda: shown)
    if failed:
        return supervised.exit_code(failed)
    if options.over_link and out.exists() and (code := _sent_over_link(out)):
        return code
    missions = supervised_run.missions.missions()
    return _verdict(console, options, monitor, missions)


def _sent_over_link(recording: Path) -> int:
    """Replace a recording by what ROS receives over its link; return the exit code."""
    with (
        progress("sending over the link") as done,
        subprocess.Popen(
            [sys.executable, "-m", "services.gateway.over_link", str(recording)],
            stdout=subprocess.PIPE,
            text=True,
            preexec_fn=end_with_parent,
        ) as process,
    ):
        assert process.stdout is not None
        for share in process.stdout:
            done(float(share))
    if process.returncode:
        recording.unlink()  # it is not what was asked for
    return process.returncode


_TOPICS = (
    Column("topic", "path"),
    Column("type", "text", omit_order=1),
    Column("messages"),
    Column("declared", omit_order=2),
    Column("measured"),
)

UNUSUAL = ("/faults/", "/gaps/")
"""Topics that are normally empty."""


def _verdict(
    console: Console,
    options: argparse.Namespace,
    monitor: RunMonitor,
    missions: Sequence[Mission],
) -> int:
    """Show the content of the file, what the vehicles did, and the verdicts on expectations.

    Return 1 if a declared rate is missing, a mission ended badly or an expectation did not pass.
    """
    out = Path(options.out)
    with needs("record"):
        from groundlink.recording.judging import judged
        from groundlink.recording.reader import Recording

    if not out.exists():
        console.print("nothing recorded: the run ended before its start")
        return 1
    with Recording(out) as recording:
        topics, scenario = recording.topics, recording.run.scenario
        with progress("judging expectations") as done:
            results = judged(recording, scenario, done)
    write_junit(options, scenario.name, results)
    table = FittingTable(str(out), _TOPICS)
    rows: list[dict[str, object]] = []
    faults = []
    for name, topic in topics.items():
        if name.startswith(UNUSUAL) and not topic.messages:
            continue
        declared, measured = (_rate(rate) for rate in (topic.declared_hz, topic.measured_hz))
        table.add_row(name, topic.type, str(topic.messages), declared, measured)
        rows.append(
            {
                "topic": name,
                "type": topic.type,
                "messages": topic.messages,
                "declared_hz": topic.declared_hz,
                "measured_hz": topic.measured_hz,
            }
        )
        if not keeps_rate(topic):
            faults.append(f"{name}: declared {declared}, measured {measured}")
    if (health := monitor.health.get(running.RECORDER)) and health.counters["bus_dropped"]:
        faults.append(
            f"{health.counters['bus_dropped']} messages dropped: faster than the recorder writes"
        )
    faults += supervised.failures(missions, [mission.vehicle for mission in missions])
    faults += problems(results)
    if options.json:
        content = {
            "path": str(out),
            "topics": rows,
            "missions": [mission.to_builtins() for mission in missions],
            "expectations": [result.to_builtins() for result in results],
            "faults": faults,
        }
        print_json(content)
        return 1 if faults else 0
    if missions:
        console.print(missions_table(missions))
    console.print(table)
    if results:
        console.print(expectations_table(results))
        terminal.say(console, summary(results))
    supervised.say_faults(console, faults, missions)
    return 1 if faults else 0


def keeps_rate(topic: TopicFacts) -> bool:
    """Return whether a recorded topic has its declared rate, if it has one."""
    declared = topic.declared_hz
    return not declared or abs((topic.measured_hz or 0.0) / declared - 1) <= RATE_TOLERANCE


def _rate(rate_hz: float | None) -> str:
    return "-" if rate_hz is None else f"{rate_hz:.2f} Hz"
