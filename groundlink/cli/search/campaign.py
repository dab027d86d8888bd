# SPDX-License-Identifier: Apache-2.0
"""`groundlink campaign SCENARIO --check COMMAND --out FOLDER`: check a stack under every fault.

Each fault of each sensor at each time, over each link, is a recording of its own. Results are a
matrix of verdicts.
"""

import argparse
import shlex
from collections.abc import Sequence

from groundlink.cli import Subparsers
from groundlink.cli.run.running import load_scenario
from groundlink.cli.terminal.json_output import print_json
from groundlink.cli.terminal.progress import progress
from groundlink.core.errors import UserError
from groundlink.core.extras import needs
from groundlink.loader.overrides import FieldChange
from groundlink.scenario.schema import Scenario
from groundlink.search.campaign import FAULT as KIND
from groundlink.search.campaign import NONE, SENSOR, cells, link_condition
from groundlink.search.point_journal import Values, key

from .result_folder import ResultFolder, add_arguments, check_options

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
    parser.add_argument(
        "--link",
        action="append",
        metavar="none|{...}",
        default=[],
        help="link to ROS as in a scenario, such as '{to_ros: {loss: 0.05}}', over which each "
        "fault is repeated; recordings then have what ROS receives; repeatable (default: no link)",
    )
    parser.set_defaults(command=campaign)


def campaign(options: argparse.Namespace) -> int:
    """Run all cells; return 1 if one failed."""
    with needs("search"):
        from groundlink.report.page.campaign_page import CampaignSummary, campaign_page

    check_options(options)
    for begin_s in options.phases:
        if not 0 <= begin_s < options.duration:
            raise UserError(
                f"--phases {begin_s:g}: expected 0 or more, and less than the {options.duration:g} "
                "s of --duration"
            )
    if options.seconds is not None and not options.seconds > 0:
        raise UserError(f"--for {options.seconds:g}: expected seconds, more than 0")
    scenario = load_scenario(options.scenario)
    if not (options.check or scenario.expect):
        raise UserError(
            f"campaign: needs --check, a shell command that judges a recording, or `expect` in "
            f"{options.scenario}"
        )
    chosen = cells(
        scenario,
        sensors=options.sensors,
        faults=options.fault,
        begins_s=options.phases,
        for_s=options.seconds,
        links=options.link,
    )
    changes = {key(cell.values): cell.changes for cell in chosen}
    unchanged = [link_condition(NONE).change] if options.link else []

    def changes_of(values: Values) -> Sequence[FieldChange]:
        return changes.get(key(values), unchanged)

    determining = ("sensors", "fault", "phases", "seconds", "link", "check", "duration")
    with ResultFolder(options, scenario, determining) as folder:
        request = folder.request(only_check=True, over_link=bool(options.link))
        with folder.processes(request, changes_of) as processes, progress("running") as done:
            if folder.unchanged(processes).verdict == "failed":
                return 1
            for number, cell in enumerate(chosen, 1):
                processes.start(CELL, number, cell.values)
            for number, cell in enumerate(chosen, 1):
                outcome = processes.result(cell.values)
                folder.say_outcome(f"{number} of {len(chosen)}: {cell}", outcome)
                done(number / len(chosen))
        rows = [row for row in folder.journal.rows if row.stage == CELL]
    summary = CampaignSummary(
        options.scenario,
        options.check,
        rows,
        _possible(scenario),
        list({cell.link.text: cell.link for cell in chosen if cell.link}.values()),
        {row.number: _command(options, changes_of(row.values)) for row in rows},
    )
    files = folder.write(rows, PAGE, campaign_page(summary))
    folder.say(f"{len(summary.failures)} of {len(rows)} failed; wrote {files}")
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
    words += ["--over-link"] if options.link else []
    words += [word for change in changes for word in ("--set", change.text)]
    return shlex.join(words)


def names(text: str) -> list[str]:
    """Return the names of an argument."""
    return [name.strip() for name in text.split(",")]


def seconds(text: str) -> list[float]:
    """Return the times of an argument."""
    return [float(number) for number in text.split(",")]
