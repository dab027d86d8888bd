# SPDX-License-Identifier: Apache-2.0
"""What commands with a journal of points share: options, and the folder of their results."""

import argparse
import hashlib
import platform
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

import msgspec

from groundlink.bus.queries import points_key
from groundlink.bus.session import Bus
from groundlink.cli.run.record import SECONDS
from groundlink.cli.run.running import SCENARIO_HELP
from groundlink.cli.terminal import output as terminal
from groundlink.cli.terminal.json_output import add_json_option
from groundlink.core import VERSION
from groundlink.core.atomic_file import write_atomically
from groundlink.core.errors import UserError
from groundlink.core.extras import check_installed
from groundlink.loader.overrides import FieldChange
from groundlink.scenario.schema import Scenario
from groundlink.search.point_journal import PointJournal, PointOutcome, PointRow, Values
from groundlink.search.point_leases import WorkerOrders, WorkerReport

from .evaluation import EvaluationRequest
from .point_processes import PointProcesses

JOURNAL = "journal.jsonl"

UNCHANGED = "scenario"
"""Stage of the run of the scenario as it is."""


def add_jobs_option(parser: argparse.ArgumentParser) -> None:
    """Add the number of runs at a time."""
    parser.add_argument(
        "--jobs",
        type=int,
        default=1,
        metavar="N",
        help="runs at a time on this machine (default %(default)s)",
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the scenario and the options that a search and a campaign share."""
    parser.add_argument("scenario", help=SCENARIO_HELP)
    parser.add_argument(
        "--check",
        metavar="COMMAND",
        help="shell command to run on each recording, whose name is its last argument; an exit "
        "code other than 0 is a failure (default: the exit code of `record` decides)",
    )
    parser.add_argument(
        "--duration",
        type=float,
        default=SECONDS,
        metavar="S",
        help="sim time of each run (default %(default)g s)",
    )
    add_jobs_option(parser)
    parser.add_argument(
        "--listen",
        metavar="ENDPOINT",
        help="let workers (`groundlink worker`) join at this endpoint, such as tcp/0.0.0.0:7447",
    )
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="FOLDER",
        help="folder of the results; the same command continues with those of an existing one",
    )
    add_json_option(parser)


def check_options(options: argparse.Namespace) -> None:
    """Check the shared options, and that the packages of the extra are installed.

    Raises
    ------
    UserError
        with one line.
    """
    check_extra()
    if not options.duration > 0:
        raise UserError(f"--duration {options.duration:g}: expected seconds, more than 0")
    least = 0 if options.listen else 1
    if options.jobs < least:
        raise UserError(f"--jobs {options.jobs}: expected {least} or more")


def check_extra() -> None:
    """Check that the packages of the extra are installed."""
    check_installed(("matplotlib", "mcap", "optuna", "pyarrow", "rosbags", "zstandard"), "search")


def content_of(scenario: Scenario) -> str:
    """Return a text that is the same for the same scenario."""
    return hashlib.sha256(msgspec.json.encode(scenario)).hexdigest()[:16]


class ResultFolder:
    """Folder of the results of a command: its journal, runs and tables. A context.

    Parameters
    ----------
    options
        of `add_arguments`.
    scenario
        the scenario without a change.
    names
        further options that determine the points or their outcomes.

    Raises
    ------
    UserError
        if the folder holds something else.
    """

    def __init__(
        self, options: argparse.Namespace, scenario: Scenario, names: Sequence[str]
    ) -> None:
        self._options, self.path = options, options.out
        self.console = terminal.console(stderr=options.json)
        is_strange = self.path.is_dir() and any(self.path.iterdir())
        if self.path.is_file() or (is_strange and not (self.path / JOURNAL).is_file()):
            raise UserError(
                f"--out {self.path}: exists without {JOURNAL}. Fix: choose a new folder"
            )
        self.path.mkdir(parents=True, exist_ok=True)
        determined_by = {
            "groundlink": VERSION,
            "scenario": options.scenario,
            "content of the scenario": content_of(scenario),
            **{f"--{name.replace('_', '-')}": getattr(options, name) for name in names},
        }
        self.journal = PointJournal(self.path / JOURNAL, determined_by)

    def __enter__(self) -> "ResultFolder":
        return self

    def __exit__(self, *_: object) -> None:
        self.journal.close()

    def request(self, **fields: Any) -> EvaluationRequest:
        """Return the request of a point; `recording` and `changes` are filled in later."""
        options = self._options
        return EvaluationRequest(
            options.scenario,
            recording="",
            duration=f"{options.duration:g}",
            check=options.check,
            **fields,
        )

    @contextmanager
    def processes(
        self, request: EvaluationRequest, changes: Callable[[Values], Sequence[FieldChange]]
    ) -> Iterator[PointProcesses]:
        """Yield the processes that evaluate points, with the changes of each; let workers join."""
        options = self._options
        with (
            PointProcesses(
                self.journal, request, changes, options.jobs, self.path, self.say
            ) as processes,
            Bus(listen=options.listen) if options.listen else nullcontext() as bus,
        ):
            if bus is not None:
                bus.serve_content(
                    points_key(), lambda _, report: [_answered(processes.exchange, report)]
                )
                reached = options.listen.replace("/0.0.0.0:", f"/{platform.node()}:")
                self.say(f"workers join by: groundlink worker --connect {reached}")
            yield processes

    def unchanged(self, processes: PointProcesses) -> PointOutcome:
        """Run the scenario as it is, and say its outcome.

        Raises
        ------
        UserError
            if there is none. The journal is then deleted.
        """
        processes.start(UNCHANGED, 1, {})
        outcome = processes.result({})
        if outcome.verdict == "broken":
            self.journal.discard()
            scenario = self._options.scenario
            raise UserError(f"{scenario}: no result without a change: {outcome.text}")
        self.say_outcome(f"{UNCHANGED}: no change", outcome)
        if outcome.verdict == "failed":
            self.say("the scenario fails without a change; nothing else is run")
        return outcome

    def say(self, line: str) -> None:
        """Print a line."""
        terminal.say(self.console, line)

    def say_outcome(self, point: str, outcome: PointOutcome) -> None:
        """Print the line of a point."""
        figure = "" if outcome.objective is None else f", objective {outcome.objective:.5g}"
        self.say(f"{point}: {outcome.verdict}{figure}: {outcome.text}")

    def write(self, rows: Sequence[PointRow], name: str, page: str) -> str:
        """Write the tables and a page; return their names."""
        from groundlink.data.point_table import CSV, PARQUET, write_point_table

        write_point_table(self.path, rows)
        with write_atomically(self.path / name) as part:
            part.write_text(page, encoding="utf-8")
        return ", ".join(str(self.path / each) for each in (name, PARQUET, CSV))


def _answered(exchange: Callable[[WorkerReport], WorkerOrders], report: bytes) -> bytes:
    return msgspec.json.encode(exchange(msgspec.json.decode(report, type=WorkerReport)))
