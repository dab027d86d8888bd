# SPDX-License-Identifier: Apache-2.0
"""What physics simulates: a scenario, a saved run to go on from, or one to do again.

Rule: the only reader of what physics is given on its command line; one line where it is none.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import NamedTuple

from msgspec.structs import replace

from groundlink.core.errors import UserError, did_you_mean
from groundlink.loader import load, time_options
from groundlink.run import journal
from groundlink.run.journal import Journal
from groundlink.scenario import Scenario


class RunSource(NamedTuple):
    """What a run is made of."""

    scenario: Scenario
    saved: Journal | None = None
    """Of a run to go on from."""

    followed: Journal | None = None
    """Of a run whose commands and changes are taken in, instead of those on the bus."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Let a user name the source."""
    parser.add_argument(
        "scenario",
        nargs="?",
        help="scenario file (YAML), the name of a shipped scenario, or a saved run to continue",
    )
    parser.add_argument(
        "--follow",
        metavar="FILE",
        help="instead of a scenario: a saved run, to do again from its start; its commands come "
        "from the file, and where that ends the run pauses",
    )
    parser.add_argument(
        "--only", metavar="VEHICLE/SENSOR", help="leave out all other sensors of the scenario"
    )
    time_options.add_arguments(parser)


def source(options: argparse.Namespace) -> RunSource:
    """Return what the command line says.

    Raises
    ------
    UserError
        when it says nothing, too much, or what cannot be.
    """
    if (options.scenario is None) == (options.follow is None):
        raise UserError("expected a scenario file, a saved run, or --follow FILE with one")
    if options.follow is not None:
        followed = journal.loaded(journal.read(Path(options.follow)), options.follow)
        # What its drivers asked for is among the commands.
        vehicles = tuple(replace(vehicle, route=None) for vehicle in followed.scenario.vehicles)
        scenario = replace(followed.scenario, vehicles=vehicles)
        return RunSource(_chosen(scenario, options), followed=followed)
    if journal.is_saved_run(Path(options.scenario)):
        saved = journal.loaded(journal.read(Path(options.scenario)), options.scenario)
        return RunSource(_chosen(saved.scenario, options), saved=saved)
    return RunSource(_chosen(load(options.scenario), options))


def _chosen(scenario: Scenario, options: argparse.Namespace) -> Scenario:
    """Return a scenario with what else the command line chooses."""
    if options.only:
        if scenario.sensor(options.only) is None:
            hint = did_you_mean(options.only, scenario.sensor_names())
            raise UserError(f"scenario `{scenario.name}` has no sensor `{options.only}`; {hint}")
        scenario = scenario.with_only(options.only)
    return time_options.with_time_options(scenario, options)
