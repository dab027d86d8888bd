# SPDX-License-Identifier: Apache-2.0
"""Runs of a bisection: `groundlink record`, a ROS stack in lockstep, or a program that records."""

import signal
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple, Protocol

from rich.console import Console

from groundlink.cli.files.verify_ros import RosStack, run_stack
from groundlink.cli.run.cases import Case, record_case, run_in_shell
from groundlink.cli.run.record import SECONDS
from groundlink.cli.run.running import load_scenario
from groundlink.cli.terminal import output as terminal
from groundlink.cli.terminal.progress import progress
from groundlink.core.errors import UserError
from groundlink.ros.streams import answers_mistake

LIMIT_SECONDS = 60.0
"""Wall time for which the sim time of a run with a stack may stand still."""


class RunRecorder(Protocol):
    """Records one run."""

    def setting(self) -> Mapping[str, str]:
        """Return what is the same in all runs, by a name for people."""

    def record(self, scenario: str, case: Case, out: Path, folder: Path | None) -> int:
        """Record a run; return the exit code, 0 or 1 if there is a recording to judge.

        Parameters
        ----------
        scenario
            name or file.
        case
            changed fields.
        out
            file to write, an absolute path.
        folder
            working directory; None: that of this process.
        """


class ScenarioRecorder(NamedTuple):
    """Records a scenario without ROS."""

    duration: str | None
    """Sim time, s; None: that of `groundlink record`."""

    def setting(self) -> Mapping[str, str]:
        """Return the duration."""
        return {"duration": f"{float(self.duration or SECONDS):g}"}

    def record(self, scenario: str, case: Case, out: Path, folder: Path | None) -> int:
        """Record a run."""
        return record_case(scenario, case, out, self.duration)


class StackRecorder(NamedTuple):
    """Records a scenario in lockstep with a ROS stack."""

    command: str
    """Shell command that starts the nodes."""

    duration: str | None
    """Sim time, s; None: that of `groundlink record`."""

    def setting(self) -> Mapping[str, str]:
        """Return the duration and the command."""
        return {"duration": f"{float(self.duration or SECONDS):g}", "stack": self.command}

    def record(self, scenario: str, case: Case, out: Path, folder: Path | None) -> int:
        """Record a run; a stack that ends or stops answering before the end makes it a bad one.

        Raises
        ------
        UserError
            if the scenario does not wait for ROS.
        """
        described = load_scenario(scenario, case)
        if described.time.lockstep != "ros":
            raise UserError(
                f"{scenario}: `time.lockstep` is not `ros`, which --stack needs. Fix: see "
                "docs/how-to/lockstep.md"
            )
        if mistake := answers_mistake(described):
            raise UserError(f"{scenario}: {mistake}")
        seconds = float(self.duration or SECONDS)
        shell = ["/bin/sh", "-c", self.command]
        stack = RosStack(scenario, shell, seconds, LIMIT_SECONDS, folder)
        changes = [word for change in case for word in ("--set", change.text)]
        log = out.with_suffix(".log")
        try:
            with _signals_kept(), progress("run with the stack"), log.open("w") as opened:
                console = Console(file=opened, width=terminal.PLAIN_WIDTH)
                end = run_stack(stack, described, console, "run", physics=changes, recording=out)
        except SystemExit as failed:
            print(f"groundlink: its lines are in {log}", file=sys.stderr)
            return int(failed.code or 1)
        if end.is_complete:
            return 0
        how = "stopped answering" if end.code is None else f"ended with exit code {end.code}"
        at = f"at {end.reached_seconds:.1f} s of {seconds:g} s"
        print(f"groundlink: the stack {how} {at}; see {log}", file=sys.stderr)
        return 1


class ProgramRecorder(NamedTuple):
    """Has a program of the user record, which decides by itself what it runs."""

    command: str
    """Shell command; its last argument is the file to write."""

    def setting(self) -> Mapping[str, str]:
        """Return the command."""
        return {"program": self.command}

    def record(self, scenario: str, case: Case, out: Path, folder: Path | None) -> int:
        """Record a run."""
        return run_in_shell(self.command, str(out), folder=folder)[1]


@contextmanager
def _signals_kept() -> Iterator[None]:
    """Restore the signal handlers after a supervised run, which replaces them for good."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
