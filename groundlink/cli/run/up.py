# SPDX-License-Identifier: Apache-2.0
"""`groundlink up SCENARIO`: run a scenario on this machine, supervised, with live status."""

import argparse
import json
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from rich.console import Console

from groundlink.cli import Subparsers
from groundlink.cli.expectations.output import add_junit_option, check_junit, write_junit
from groundlink.cli.run.dashboard import dashboard
from groundlink.cli.terminal import output as terminal
from groundlink.cli.terminal.json_output import add_json_option, print_json
from groundlink.core.atomic_file import check_new_file, write_atomically
from groundlink.core.errors import UserError
from groundlink.episode import journal
from groundlink.episode.mission import Mission
from groundlink.expectations.results import problems
from groundlink.loader import overrides, time_options
from groundlink.messages.base import NOT_REPORTED
from groundlink.monitor import process_commands
from groundlink.monitor.expectation_monitor import ExpectationMonitor
from groundlink.monitor.mission_monitor import MissionMonitor
from groundlink.monitor.run_monitor import RunMonitor

from . import running, seek, supervised

START_SECONDS = 20.0
"""Maximum wait for streams before the duration starts."""

SEEKED = "instant.run"
"""File of a saved run at an instant of a recording."""

TELL_SECONDS = 4.0
"""Time after which the command reports what it waits for."""


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("up", help="run a scenario on this machine")
    parser.add_argument(
        "scenario",
        help=f"{running.SCENARIO_HELP}; a saved run to continue; or, with --at, a recording",
    )
    seek.add_instant(
        parser,
        required=False,
        help_text="start at this sim time of a recorded run, in seconds, and paused",
    )
    parser.add_argument(
        "--duration",
        type=float,
        metavar="S",
        help="stop after S seconds of sim time, counted from the arrival of every stream; with "
        "--no-ros and a ROS side that sends no reports, from the first message of every stream",
    )
    parser.add_argument(
        "--report", type=Path, metavar="FILE.json", help="write a report of the run"
    )
    running.add_arguments(parser, "scenario's")
    add_json_option(parser, "print the report of the run as JSON; tables go to stderr")
    add_junit_option(parser)
    parser.add_argument(
        "--until-decided",
        action="store_true",
        help="stop as soon as one of the scenario's expectations has failed, or all that can pass "
        "before the end of the run have passed",
    )
    parser.add_argument(
        "--sensors-together",
        action="store_true",
        help="run all sensors in one process: less overhead, but they wait for each other",
    )
    parser.add_argument("--record", metavar="RUN.mcap", help="also record the run to a file")
    parser.add_argument(
        "--view",
        action="store_true",
        help="also show the run in Rerun: in a window, or in a browser without a display",
    )
    overrides.add_argument(parser)
    time_options.add_arguments(parser)
    parser.set_defaults(command=up)


def up(options: argparse.Namespace) -> int:
    """Run a scenario until Ctrl-C or `--duration`; return 0 if it went as it should.

    Every declared rate was kept. No vehicle ended stuck, drowned, tipped over, falling or off the
    map, if it has a route or the run a duration. Every expectation of the scenario passed.
    """
    is_recording = Path(options.scenario).suffix == ".mcap"
    if options.at is None and is_recording:
        raise UserError(
            f"{options.scenario}: a recording. Fix: pass the instant to start at, --at S"
        )
    if options.at is None:
        return _up(options)
    if not is_recording:
        raise UserError(
            f"--at {options.at:g}: expected a recording, got `{options.scenario}`. Fix: pass a "
            "file that `groundlink record --checkpoints 5 --out RUN.mcap` wrote"
        )
    content = seek.saved_run(Path(options.scenario), options.at)
    with tempfile.TemporaryDirectory() as folder:
        options.scenario = str(Path(folder, SEEKED))
        journal.write(Path(options.scenario), content)
        return _up(options)


def _up(options: argparse.Namespace) -> int:
    if journal.is_saved_run(file := Path(options.scenario)):
        described = journal.loaded(journal.read(file), options.scenario).remaining_scenario()
        if options.set:
            raise UserError("--set: a saved run keeps its scenario. Fix: pass a scenario file")
    else:
        changes = overrides.field_changes(options.set)
        described = running.load_scenario(options.scenario, changes)
    scenario = time_options.with_time_options(described, options)
    if options.duration is not None and not options.duration > 0:
        raise UserError(f"--duration {options.duration:g}: expected seconds, more than 0")
    if options.report and not options.report.resolve().parent.is_dir():
        raise UserError(f"--report {options.report}: no such folder: {options.report.parent}")
    if options.record:
        check_new_file("--record", Path(options.record))
    check_junit(options)
    if options.until_decided and not scenario.expect:
        raise UserError(
            f"--until-decided: {options.scenario} has no expectations. Fix: add `expect`"
        )
    run = options.run or scenario.name
    console = terminal.console(stderr=options.json)
    commands = process_commands.commands(
        *(scenario, options.scenario, run, options.listen),
        sensors_together=options.sensors_together,
    )
    commands["physics"] += overrides.forwarded(options) + time_options.forwarded(options)
    if options.at is not None:
        commands["physics"] += ["--paused"]
    if options.record:
        commands["physics"] += ["--wait-for", running.RECORDER]
        commands[running.RECORDER] = process_commands.recorder(options.record, run, options.listen)
    if not options.no_ros:
        commands[running.ROS_SIDE] = running.ros_side(scenario.gateway, console)
    if options.view:
        commands[running.VIEWER] = running.viewer(run, options.listen)
    # In real time no process waits for sensors or recorders, so the run continues without them.
    is_realtime = scenario.time.mode == "realtime"
    of_sensors = process_commands.sensor_processes(scenario, scenario.sensor_names())
    dispensable = (*of_sensors, running.RECORDER) if is_realtime else ()
    supervised_run = supervised.SupervisedRun(
        *(commands, run, options.listen, console),
        finite=[running.VIEWER],  # The run continues after its window was closed.
        dispensable=dispensable,
        missions=MissionMonitor(scenario),
        expectations=ExpectationMonitor(scenario, run),
    )
    monitor, children = supervised_run.monitor, supervised_run.children
    missions, expectations = supervised_run.missions.missions, supervised_run.expectations
    title = f"{scenario.name} (run `{run}`)"
    started = time.time()
    duration = Duration(
        monitor, options.duration, needs_reports=not options.no_ros, say=supervised_run.log
    )
    failed = supervised_run.go(
        lambda: duration.is_over() or (options.until_decided and expectations.is_settled),
        lambda: dashboard(title, monitor, children.values(), missions(), expectations.results()),
    )
    if supervised_run.killed:
        names = ", ".join(supervised_run.killed)
        terminal.say(console, f"killed after the timeout for a clean exit: {names}")
    if failed and not failed.ended_run and monitor.first_tick is None:
        return supervised.exit_code(failed)
    needs_reports = not options.no_ros
    faults = []
    if monitor.streams or needs_reports:
        faults = monitor.faults(needs_reports=needs_reports)
    if options.record and children[running.RECORDER].is_skipped:
        faults.append(f"{options.record}: incomplete; see the error line of the recorder above")
    judged = [vehicle.name for vehicle in scenario.vehicles if options.duration or vehicle.route]
    faults += supervised.failures(missions(), judged)
    results = expectations.results()
    faults += problems(results)
    write_junit(options, scenario.name, results)
    console.print(dashboard("summary", monitor, children.values(), missions(), results))
    _summarize(console, monitor, missions(), faults)
    report = supervised_run.report(scenario, started, faults)
    if options.json:
        print_json(report)
    if options.report:
        with write_atomically(options.report) as part:
            part.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    if failed:
        return supervised.exit_code(failed)
    return 1 if faults else 0


class Duration:
    """End condition: sim time since every stream arrived, or since `START_SECONDS` after the start.

    If reports of the ROS side are optional and missing, since every stream was sent.
    """

    def __init__(
        self,
        monitor: RunMonitor,
        seconds: float | None,
        *,
        needs_reports: bool = True,
        say: Callable[[str], object] = lambda line: None,
    ) -> None:
        self._monitor = monitor
        self._seconds = seconds
        self._needs_reports = needs_reports
        self._begun = time.monotonic()
        self._counted_from: float | None = None
        self._sent_from: float | None = None
        self._say = say
        self._is_reported = False

    def is_over(self) -> bool:
        """Return whether the duration is over; without a duration it never is."""
        monitor = self._monitor
        late = time.monotonic() - self._begun > START_SECONDS
        if self._counted_from is None and (monitor.everything_arrives() or late):
            self._counted_from = monitor.sim_seconds
        if self._sent_from is None and monitor.everything_is_sent():
            self._sent_from = monitor.sim_seconds
        counted_from = self._counted_from
        if not self._needs_reports and not monitor.is_reported and self._sent_from is not None:
            counted_from = self._sent_from
        if self._seconds is None:
            return False
        self._report(counted_from is not None, late)
        if counted_from is None:
            return False
        return monitor.sim_seconds - counted_from >= self._seconds

    def _report(self, is_counted: bool, late: bool) -> None:
        """Log once which streams are missing, and once if the duration starts without them."""
        monitor = self._monitor
        if self._needs_reports or monitor.is_reported:
            missing = ", ".join(monitor.not_arrived()) or "the first report of the ROS side"
        else:
            missing = ", ".join(monitor.not_sent()) or "the gateway"
        waited = time.monotonic() - self._begun
        if not is_counted and not self._is_reported and waited > TELL_SECONDS:
            self._is_reported = True
            self._say(f"--duration: waiting for {missing} (at most {START_SECONDS:g} s)")
        elif is_counted and late and self._is_reported:
            self._is_reported = False
            self._say(f"--duration: started without {missing}")


def _summarize(
    console: Console,
    monitor: RunMonitor,
    missions: Sequence[Mission],
    faults: list[str],
) -> None:
    supervised.say_faults(console, faults, missions)
    if monitor.streams and not monitor.is_reported:
        line = f"{NOT_REPORTED}: the ROS side sent no TopicReport"
        terminal.say(console, line)
    elif not faults:
        terminal.say(console, "every declared rate was kept within 2 %")
