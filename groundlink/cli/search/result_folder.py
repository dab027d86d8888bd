# SPDX-License-Identifier: Apache-2.0
"""What commands with a journal of points share: options, folder, lines of points."""

import argparse
import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
from rich.console import Console

from groundlink.cli.run.record import SECONDS
from groundlink.cli.run.running import SCENARIO_HELP
from groundlink.cli.terminal import output as terminal
from groundlink.cli.terminal.json_output import add_json_option
from groundlink.core import VERSION
from groundlink.core.errors import UserError
from groundlink.core.extras import check_installed
from groundlink.scenario.schema import Scenario
from groundlink.search.point_journal import PointJournal, PointOutcome

from .point_processes import PointProcesses

JOURNAL = "journal.jsonl"

UNCHANGED = "scenario"
"""Stage of the run of the scenario as it is."""


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
    parser.add_argument(
        "--jobs",
        type=int,
        default=1,
        metavar="N",
        help="runs at a time (default %(default)s)",
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
    check_installed(("matplotlib", "mcap", "optuna", "pyarrow", "rosbags", "zstandard"), "search")
    if not options.duration > 0:
        raise UserError(f"--duration {options.duration:g}: expected seconds, more than 0")
    if options.jobs < 1:
        raise UserError(f"--jobs {options.jobs}: expected 1 or more")


def identity(options: argparse.Namespace, scenario: Scenario, *names: str) -> dict[str, Any]:
    """Return what determines the points of a command and their outcomes, by name."""
    content = hashlib.sha256(msgspec.json.encode(scenario)).hexdigest()[:16]
    return {
        "groundlink": VERSION,
        "scenario": options.scenario,
        "content of the scenario": content,
        **{f"--{name.replace('_', '-')}": getattr(options, name) for name in names},
    }


@contextmanager
def opened_journal(out: Path, determined_by: dict[str, Any]) -> Iterator[PointJournal]:
    """Yield the journal of a new folder or of one with the same identity.

    Raises
    ------
    UserError
        if the folder holds something else.
    """
    if out.is_file() or (out.is_dir() and any(out.iterdir()) and not (out / JOURNAL).is_file()):
        raise UserError(f"--out {out}: exists without {JOURNAL}. Fix: choose a new folder")
    out.mkdir(parents=True, exist_ok=True)
    journal = PointJournal(out / JOURNAL, determined_by)
    try:
        yield journal
    finally:
        journal.close()


def unchanged_outcome(
    console: Console, processes: PointProcesses, journal: PointJournal, scenario: str
) -> PointOutcome:
    """Run the scenario as it is, and say its outcome.

    Raises
    ------
    UserError
        if there is none. The journal is then deleted.
    """
    processes.start(UNCHANGED, 1, {})
    outcome = processes.result({})
    if outcome.verdict == "broken":
        journal.discard()
        raise UserError(f"{scenario}: no result without a change: {outcome.text}")
    say_outcome(console, f"{UNCHANGED}: no change", outcome)
    if outcome.verdict == "failed":
        terminal.say(console, "the scenario fails without a change; nothing else is run")
    return outcome


def say_outcome(console: Console, point: str, outcome: PointOutcome) -> None:
    """Print the line of a point."""
    figure = "" if outcome.objective is None else f", objective {outcome.objective:.5g}"
    terminal.say(console, f"{point}: {outcome.verdict}{figure}: {outcome.text}")
