# SPDX-License-Identifier: Apache-2.0
"""`groundlink campaign SCENARIO --check COMMAND --out FOLDER`: check a stack under every fault.

Each fault of each sensor at each time is a recording of its own. Results are a matrix of verdicts.
"""

import argparse
import shlex
from collections.abc import Sequence

from groundlink.cli import Subparsers
from groundlink.cli.run.running import load_scenario
from groundlink.cli.terminal import output as terminal
from groundlink.cli.terminal.json_output import print_json
from groundlink.cli.terminal.progress import progress
from groundlink.core.atomic_file import write_atomically
from groundlink.core.errors import UserError
from groundlink.core.extras import needs
from groundlink.loader.overrides import FieldChange
from groundlink.scenario.schema import Scenario
from groundlink.search.campaign import FAULT as KIND
from groundlink.search.campaign import SENSOR, cells
from groundlink.search.point_journal import Values, key

from .evaluation import EvaluationRequest
from .point_processes import PointProcesses
from .result_folder import (
    add_arguments,
    check_options,
    identity,
    opened_journal,
    say_outcome,
    unchanged_outcome,
)

PAGE = "campaign.html"

CELL = "campaign"
"""Stage of the runs with a fault."""


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "campaign",
        help="check a scenario under each fault of each sensor; write a matrix of verdicts",
        description="Record a scenario once for each sensor, each fault that it can have, and each "
        "time at which the fault begins, and run the check on each recording.",
    )
    add_arguments(parser)
    parser.add_argument(
        "--sensors",
        metavar="VEHICLE/SENSOR,...",
        type=names,
        default=[],
        help="sensors that have the faults (default: all)",
    )
    parser.add_argument(
        "--fault",
        action="append",
        metavar="KIND|{...}",
        default=[],
        help="kind of fault with its typical size, or a fault as in a scenario such as "
        "'{kind: drop, share: 0.9}'; repeatable (default: all kinds)",
    )
    parser.add_argument(
        "--phases",
        metavar="S,...",
        type=seconds,
        default=[1.0],
        help="sim times at which a fault begins (default 1)",
    )
    parser.add_argument(
        "--for", type=float, dest="seconds", metavar="S", help="length of a fault (default: rest)"
    )
    parser.set_defaults(command=campaign)


def campaign(options: argparse.Namespace) -> int:
    """Run all cells; return 1 if the check failed in one."""
    with needs("search"):
        from groundlink.data.point_table import CSV, PARQUET, write_point_table
        from groundlink.report.page.campaign_page import CampaignSummary, campaign_page

    check_options(options)
    if not options.check:
        raise UserError("campaign: needs --check, a shell command that judges a recording")
    for begin_s in options.phases:
        if not 0 <= begin_s < options.duration:
            raise UserError(
                f"--phases {begin_s:g}: expected 0 or more, and less than the {options.duration:g} "
                "s of --duration"
            )
    if options.seconds is not None and not options.seconds > 0:
        raise UserError(f"--for {options.seconds:g}: expected seconds, more than 0")
    scenario = load_scenario(options.scenario)
    chosen = cells(
        scenario,
        sensors=options.sensors,
        faults=options.fault,
        begins_s=options.phases,
        for_s=options.seconds,
    )
    determining = ("sensors", "fault", "phases", "seconds", "check", "duration")
    with opened_journal(options.out, identity(options, scenario, *determining)) as journal:
        changes = {key(cell.values): [cell.change] for cell in chosen}
        request = EvaluationRequest(
            options.scenario,
            recording="",
            duration=f"{options.duration:g}",
            check=options.check,
            only_check=True,
        )

        def changes_of(values: Values) -> Sequence[FieldChange]:
            return changes.get(key(values), ())

        console = terminal.console(stderr=options.json)
        with (
            PointProcesses(journal, request, changes_of, options.jobs, options.out) as processes,
            progress("running") as done,
        ):
            unchanged = unchanged_outcome(console, processes, journal, options.scenario)
            if unchanged.verdict == "failed":
                return 1
            for number, cell in enumerate(chosen, 1):
                processes.start(CELL, number, cell.values)
            for number, cell in enumerate(chosen, 1):
                outcome = processes.result(cell.values)
                say_outcome(console, f"{number} of {len(chosen)}: {cell}", outcome)
                done(number / len(chosen))
        rows = [row for row in journal.rows if row.stage == CELL]
    summary = CampaignSummary(
        options.scenario,
        options.check,
        rows,
        _possible(scenario),
        {row.number: _command(options, changes_of(row.values)) for row in rows},
    )
    write_point_table(options.out, rows)
    with write_atomically(options.out / PAGE) as part:
        part.write_text(campaign_page(summary), encoding="utf-8")
    files = ", ".join(str(options.out / name) for name in (PAGE, PARQUET, CSV))
    terminal.say(console, f"{len(summary.failures)} of {len(rows)} failed; wrote {files}")
    if options.json:
        print_json({"cells": rows})
    return 1 if summary.failures else 0


def _possible(scenario: Scenario) -> dict[str, list[str]]:
    """Return the kinds of faults that each sensor can have."""
    possible: dict[str, list[str]] = {
        f"{vehicle.name}/{spec.name}": []
        for vehicle in scenario.vehicles
        for spec in vehicle.sensors
    }
    for cell in cells(scenario, sensors=(), faults=(), begins_s=[0.0], for_s=None):
        possible[cell.values[SENSOR]].append(cell.values[KIND])
    return possible


def _command(options: argparse.Namespace, changes: Sequence[FieldChange]) -> str:
    """Return the command line that repeats a run."""
    words = ["groundlink", "record", options.scenario, "--out", "again.mcap"]
    words += ["--duration", f"{options.duration:g}"]
    words += [word for change in changes for word in ("--set", change.text)]
    return shlex.join(words)


def names(text: str) -> list[str]:
    """Return the names of an argument."""
    return [name.strip() for name in text.split(",")]


def seconds(text: str) -> list[float]:
    """Return the times of an argument."""
    return [float(number) for number in text.split(",")]
