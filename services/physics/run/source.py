# SPDX-License-Identifier: Apache-2.0
"""Options that say what to simulate: a scenario, or a saved run to continue or replay."""

import argparse
from pathlib import Path
from typing import NamedTuple

from msgspec.structs import replace

from groundlink.core.errors import UserError, did_you_mean
from groundlink.episode import journal
from groundlink.episode.journal import Journal
from groundlink.loader import load, overrides, time_options
from groundlink.scenario import Scenario


class RunSource(NamedTuple):
    """What to simulate."""

    scenario: Scenario
    saved: Journal | None = None
    """A saved run to continue."""

    followed: Journal | None = None
    """A saved run to replay: its commands and changes take the place of those on the bus."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "scenario",
        nargs="?",
        help="scenario file (YAML), the name of a shipped scenario, or a saved run to continue",
    )
    parser.add_argument(
        "--follow",
        metavar="FILE",
        help="replay a saved run from its start, in place of a scenario: commands come from the "
        "file, and the run pauses at its end",
    )
    parser.add_argument(
        "--only", metavar="VEHICLE/SENSOR", help="leave out all other sensors of the scenario"
    )
    overrides.add_argument(parser)
    time_options.add_arguments(parser)


def source_of(options: argparse.Namespace) -> RunSource:
    """Return what the options say.

    Raises
    ------
    UserError
        when they name no source or two, or one that cannot be read.
    """
    if (options.scenario is None) == (options.follow is None):
        raise UserError("expected a scenario file, a saved run, or --follow FILE with one")
    if options.set and (options.follow or journal.is_saved_run(Path(options.scenario))):
        raise UserError("--set: a saved run keeps its scenario. Fix: pass a scenario file")
    if options.follow is not None:
        followed = journal.loaded(journal.read(Path(options.follow)), options.follow)
        # Without routes: the drivers' commands are in the journal.
        vehicles = tuple(replace(vehicle, route=None) for vehicle in followed.scenario.vehicles)
        scenario = replace(followed.scenario, vehicles=vehicles)
        return RunSource(_adjusted(scenario, options), followed=followed)
    if journal.is_saved_run(Path(options.scenario)):
        saved = journal.loaded(journal.read(Path(options.scenario)), options.scenario)
        return RunSource(_adjusted(saved.scenario, options), saved=saved)
    changes = overrides.field_changes(options.set)
    return RunSource(_adjusted(load(options.scenario, changes=changes), options))


def _adjusted(scenario: Scenario, options: argparse.Namespace) -> Scenario:
    """Return a scenario with its sensors and its time as the options say."""
    if options.only:
        if scenario.sensor(options.only) is None:
            hint = did_you_mean(options.only, scenario.sensor_names())
            raise UserError(f"scenario `{scenario.name}` has no sensor `{options.only}`; {hint}")
        scenario = scenario.with_only(options.only)
    return time_options.with_time_options(scenario, options)
