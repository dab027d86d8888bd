# SPDX-License-Identifier: Apache-2.0
"""Supervised run: processes that a command starts, monitors, shows and stops."""

import dataclasses
import sys
import time
from collections import deque
from collections.abc import Callable, Collection, Container, Iterable, Mapping, Sequence

import msgspec
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from groundlink.bus.core_topics import HEALTH, RECORDER
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.cli.terminal.output import CroppedPicture, display, say
from groundlink.core import VERSION
from groundlink.core.errors import UserError
from groundlink.episode.mission import Mission
from groundlink.messages.base import Health
from groundlink.monitor.expectation_monitor import ExpectationMonitor
from groundlink.monitor.mission_monitor import MissionMonitor
from groundlink.monitor.run_monitor import RunMonitor
from groundlink.monitor.supervisor import EXPLAINED, Child, Supervisor
from groundlink.process.runner import stop_on_signals
from groundlink.scenario import Scenario

LINES_SHOWN = 5
"""Number of log lines below the live status."""

BAR_WIDTH = 30

LINES_KEPT = 500
"""Number of log lines printed after the run."""


class SupervisedRun:
    """Processes of a run on this machine, with the router and a monitor of their health.

    Handles Ctrl-C and SIGTERM from its construction on.

    Parameters
    ----------
    commands
        command lines by process name; see `process_commands.commands`.
    run
        the run's name.
    endpoint
        endpoint of the router.
    shown
        console for log lines and the live status.
    finite
        processes that end by themselves.
    dispensable
        processes without which the run continues.
    missions
        monitor of the vehicles; it receives the messages of the run.
    expectations
        monitor of the scenario's expectations; it receives messages of the run, too.
    """

    def __init__(
        self,
        commands: Mapping[str, Sequence[str]],
        run: str,
        endpoint: str,
        shown: Console,
        *,
        finite: Collection[str] = (),
        dispensable: Collection[str] = (),
        missions: MissionMonitor | None = None,
        expectations: ExpectationMonitor | None = None,
    ) -> None:
        self.monitor = RunMonitor()
        self.missions = missions or MissionMonitor()
        self.expectations = expectations or ExpectationMonitor()
        self.killed: list[str] = []
        """Processes that did not exit in time."""
        self._run, self._endpoint, self._shown = run, endpoint, shown
        self._supervisor = Supervisor(commands, self._log, finite=finite, dispensable=dispensable)
        self._stop = stop_on_signals()
        self._lines: deque[str] = deque(maxlen=LINES_KEPT)
        """Log lines of processes, on a terminal."""

    @property
    def children(self) -> Mapping[str, Child]:
        """Processes by name."""
        return self._supervisor.children

    @property
    def is_interrupted(self) -> bool:
        """Whether Ctrl-C or SIGTERM came."""
        return self._stop.is_set()

    def go(
        self, is_over: Callable[[], bool], picture: Callable[[], RenderableType]
    ) -> Child | None:
        """Run until `is_over()`; stop every process.

        Parameters
        ----------
        is_over
            polled end condition.
        picture
            returns the live status.

        Returns
        -------
        The process that ended the run or failed; None otherwise. See `exit_code`.
        """
        with Bus(listen=self._endpoint) as bus:
            inbox: BusInbox[Health] = BusInbox(depth=1024)
            bus.subscribe(HEALTH.key_in(self._run), Health, inbox)
            self.missions.subscribe(bus, self._run)
            self.expectations.subscribe(bus)
            try:
                self._supervisor.start()
                shown = display(self._shown, lambda: self._with_lines(picture()))
                failed = self._monitor_loop(inbox, is_over, shown)
            finally:
                self.killed = self._supervisor.stop()
                for line in self._lines:
                    say(self._shown, line)
            self._update_monitor(inbox)
        return failed

    def report(
        self, scenario: Scenario, started: float, faults: Sequence[str]
    ) -> dict[str, object]:
        """Return the report of the run as plain data; it started at this Unix time."""
        monitor = self.monitor
        return {
            "groundlink": VERSION,
            "run": self._run,
            "started": started,
            "sim_seconds": monitor.sim_seconds,
            "real_time_factor": monitor.real_time_factor,
            "stalls": dataclasses.asdict(monitor.stalls),
            "faults": faults,
            "missions": [mission.to_builtins() for mission in self.missions.missions()],
            "expectations": [result.to_builtins() for result in self.expectations.results()],
            "streams": [msgspec.to_builtins(stream) for stream in monitor.streams],
            "processes": {
                name: {
                    "restarts": child.restarts,
                    "last_exit": child.last_exit,
                    "counters": counters,
                }
                for child in self.children.values()
                for name, counters in monitor.counters_of(child.name, child.pid).items()
            },
            "scenario": msgspec.to_builtins(scenario),
        }

    def _monitor_loop(
        self, inbox: BusInbox[Health], is_over: Callable[[], bool], show: Callable[[bool], None]
    ) -> Child | None:
        failed = None
        while not (failed or self._stop.is_set() or is_over()):
            failed = self._supervisor.poll()
            self._update_monitor(inbox)
            self._update_verdicts()
            show(False)
        self._update_verdicts()  # Not later: processes end one after the other.
        self.expectations.finish()
        show(True)
        return self.children[failed] if failed else None

    def _update_verdicts(self) -> None:
        """Process the messages that verdicts are made of."""
        self.missions.update()
        self.expectations.update(self.monitor)

    def _update_monitor(self, inbox: BusInbox[Health]) -> None:
        """Pass waiting health messages to the monitor; wait briefly for the first."""
        while arrived := inbox.get(seconds=0.0 if len(inbox) else 0.05):
            self.monitor.update(arrived[1], time.monotonic())
            if self._stop.is_set():
                break

    def _log(self, name: str, line: str) -> None:
        line = line.removeprefix(f"{name}: ")  # error lines start with the name
        self.log(f"{name}: {line}")

    def log(self, line: str) -> None:
        """Show a line: below the live status, or immediately without a terminal."""
        if self._shown.is_terminal:
            self._lines.append(line)
        else:
            say(self._shown, line)

    def _with_lines(self, picture: RenderableType) -> RenderableType:
        """Return the live status above the newest log lines."""
        newest = list(self._lines)[-LINES_SHOWN:]
        top = CroppedPicture(picture, rows_below=len(newest))
        return Group(top, *(Text(line, no_wrap=True, overflow="ellipsis") for line in newest))


class RecorderProgress:
    """Sim time that a recorder has processed, of its duration: a bar on terminals, and figures.

    Parameters
    ----------
    monitor
        monitor of the run.
    seconds
        sim time at the end.
    done
        returns the sim time that is done and more figures, from the recorder's health.
    """

    def __init__(
        self, monitor: RunMonitor, seconds: float, done: Callable[[Health], tuple[float, str]]
    ) -> None:
        self._monitor, self._seconds, self._done = monitor, seconds, done

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Render one line."""
        health = self._monitor.health.get(RECORDER)
        if health is None or health.tick < 0:
            yield Text("starting")
            return
        done_seconds, figures = self._done(health)
        factor = self._monitor.real_time_factor
        pace = "" if factor is None else f", {factor:.2f} x real time"
        text = Text(f"{done_seconds:.1f} of {self._seconds:.1f} s{pace}{figures}")
        if not console.is_terminal:
            yield text
            return
        line = Table.grid(padding=(0, 1))
        line.add_row(ProgressBar(self._seconds, done_seconds, width=BAR_WIDTH), text)
        yield line


def failures(missions: Iterable[Mission], judged: Container[str]) -> list[str]:
    """Return how the missions of the judged vehicles ended badly as lines."""
    lines = (mission.failure() for mission in missions if mission.vehicle in judged)
    return [line for line in lines if line is not None]


def say_faults(shown: Console, faults: Sequence[str], missions: Iterable[Mission]) -> None:
    """Print why a run failed, and what else happened to its vehicles."""
    for fault in faults:
        say(shown, f"failed: {fault}")
    for line in (line for mission in missions for line in mission.problems()):
        if line not in faults:
            say(shown, f"warning: {line}")


def exit_code(child: Child) -> int:
    """Print which process ended the run; return the exit code of the command."""
    if child.ended_run:
        print(f"groundlink: {child.name} ended the run; see its line above", file=sys.stderr)
        return 1
    print(f"groundlink: {child.name} failed; see its line above", file=sys.stderr)
    return child.code if child.code in EXPLAINED else UserError.exit_code
