# SPDX-License-Identifier: Apache-2.0
"""`groundlink try VEHICLE`: put a vehicle through the trials of the shipped ones.

Physics runs in a process of its own, without a bus.
"""

import argparse
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import msgspec

from groundlink.cli import Subparsers
from groundlink.cli.terminal.json_output import add_json_option, print_json
from groundlink.cli.terminal.output import console, say
from groundlink.cli.terminal.progress import progress
from groundlink.cli.terminal.tables import Column, FittingTable
from groundlink.core.atomic_file import write_atomically
from groundlink.core.errors import UserError
from groundlink.core.extras import needs
from groundlink.report.analysis.trials import Trial

MAX_SLOPE_DEG = 45.0
"""Steeper slopes need tires with a friction above 1."""


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "try", help="try what a vehicle can do: stand, drive, turn, stop, climb, lean"
    )
    add_trial_arguments(parser)
    parser.add_argument(
        "--out", type=Path, metavar="TRIALS.html", help="also draw the trials on a page"
    )
    add_json_option(parser)
    parser.set_defaults(command=try_vehicle)


def add_trial_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that the process of the trials shares."""
    parser.add_argument(
        "vehicle",
        metavar="VEHICLE|FILE.yaml",
        help="vehicle file (YAML), or name of a shipped vehicle",
    )
    parser.add_argument(
        "--slope",
        type=_slope,
        default=20.0,
        metavar="DEG",
        help="slope to climb and to stand across, in degrees (%(default)g)",
    )


def try_vehicle(options: argparse.Namespace) -> int:
    """Show the trials of a vehicle; return 1 if a figure is not as expected."""
    name = Path(options.vehicle).stem
    if options.out and not options.out.resolve().parent.is_dir():
        raise UserError(f"--out {options.out}: no such folder: {options.out.parent}")
    if options.out:
        with needs("report"):
            from groundlink.report.page.trials_page import trials_page
    command = ["-m", "services.physics.trials", options.vehicle, f"--slope={options.slope:g}"]
    with progress(f"trying {name}"):
        done = subprocess.run([sys.executable, *command], stdout=subprocess.PIPE, check=False)
    if done.returncode:
        return done.returncode
    trials = msgspec.json.decode(done.stdout, type=list[Trial])
    if options.out:
        with write_atomically(options.out) as part:
            part.write_text(trials_page(name, trials), encoding="utf-8")
    if options.json:
        print_json([_without_plots(trial) for trial in trials])
    else:
        _show(name, trials)
        if options.out:
            print(f"wrote {options.out}")
    return 0 if all(trial.good for trial in trials) else 1


_COLUMNS = (
    Column("trial", "text"),
    Column("figure", "words"),
    Column("measured"),
    Column("expected"),
)


def _show(name: str, trials: Sequence[Trial]) -> None:
    shown = console()
    table = FittingTable(name, _COLUMNS)
    for trial in trials:
        for figure in trial.figures:
            style = "" if figure.good else "red"
            table.add_row(trial.name, figure.name, str(figure), figure.expected, style=style)
    shown.print(table)
    for trial in trials:
        missed = ", ".join(figure.name for figure in trial.figures if not figure.good)
        if missed:
            say(shown, f"failed: {trial.description}: {missed} not as expected. Fix: {trial.fix}")


def _without_plots(trial: Trial) -> dict[str, object]:
    """Return a trial as plain data, with its verdict instead of its plots."""
    plain: dict[str, object] = msgspec.to_builtins(trial)
    del plain["plots"]
    return plain | {"good": trial.good}


def _slope(text: str) -> float:
    try:
        degrees = float(text)
    except ValueError:
        degrees = -1.0
    if not 0 < degrees <= MAX_SLOPE_DEG:
        raise argparse.ArgumentTypeError(
            f"`{text}`: expected degrees, more than 0 and at most {MAX_SLOPE_DEG:g}"
        )
    return degrees
