# SPDX-License-Identifier: Apache-2.0
"""Output of verdicts on expectations: a table, and the option `--junit`."""

import argparse
from collections.abc import Iterable, Sequence
from pathlib import Path

from groundlink.cli.terminal.tables import Column, FittingTable
from groundlink.core.atomic_file import write_atomically
from groundlink.core.errors import UserError
from groundlink.expectations.junit import junit
from groundlink.expectations.results import COLUMNS, FAILED, PASSED, ExpectationResult

_KINDS = ("words", "text", "number", "number", "words")
_COLUMNS = [Column(title, kind) for title, kind in zip(COLUMNS, _KINDS, strict=True)]


def add_junit_option(parser: argparse.ArgumentParser) -> None:
    """Add the option to a command."""
    parser.add_argument(
        "--junit",
        type=Path,
        metavar="FILE",
        help="write the verdicts on the scenario's expectations as JUnit XML",
    )


def check_junit(options: argparse.Namespace) -> None:
    """Check before a run that the file can be written.

    Raises
    ------
    UserError
        when its folder does not exist.
    """
    if options.junit and not options.junit.resolve().parent.is_dir():
        raise UserError(f"--junit {options.junit}: no such folder: {options.junit.parent}")


def write_junit(
    options: argparse.Namespace, name: str, results: Sequence[ExpectationResult]
) -> None:
    """Write the results of the scenario of this name, if the option is given."""
    if options.junit:
        with write_atomically(options.junit) as part:
            part.write_text(junit(name, results), encoding="utf-8")


def expectations_table(results: Iterable[ExpectationResult]) -> FittingTable:
    """Return the table of expectations with their verdicts."""
    table = FittingTable("expectations", _COLUMNS)
    for result in results:
        style = "red" if result.verdict == FAILED else "yellow" if result.is_problem else ""
        table.add_row(*result.cells, style=style)
    return table


def summary(results: Sequence[ExpectationResult]) -> str:
    """Return how many expectations passed as a line."""
    judged = [result for result in results if not result.skipped]
    passed = sum(result.verdict == PASSED for result in judged)
    return f"{passed} of {len(judged)} expectations passed"
