# SPDX-License-Identifier: Apache-2.0
"""Command-line options that override the `time` section of a scenario.

Each option has the name of a field of `Time`, whose type also checks the value.
"""

import argparse
from typing import Any

from msgspec.structs import replace

from groundlink.core.errors import UserError
from groundlink.ros.streams import answers_mistake
from groundlink.scenario.lockstep_window import window_mistake
from groundlink.scenario.schema import Scenario

OPTIONS: dict[str, dict[str, Any]] = {
    "mode": {"choices": ("realtime", "fast", "lockstep")},
    "factor": {"type": float, "metavar": "F"},
    "lockstep": {"choices": ("sensors", "ros")},
    "overload": {"choices": ("slow", "skip", "fail")},
}
"""Argument parser settings of each option, by field of `Time`."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options to a command."""
    for field, how in OPTIONS.items():
        parser.add_argument(f"--{field}", **how, help="instead of the scenario's")


def with_time_options(scenario: Scenario, options: argparse.Namespace) -> Scenario:
    """Return a scenario with the given time options.

    Raises
    ------
    UserError
        when the scenario cannot run with them.
    """
    given = {field: v for field in OPTIONS if (v := getattr(options, field)) is not None}
    if not given.get("factor", 1.0) > 0:
        raise UserError(f"--factor {given['factor']:g}: expected more than 0")
    try:
        time = replace(scenario.time, **given)
    except ValueError as error:
        raise UserError(f"scenario `{scenario.name}`, `time`: {error}") from None
    sensors = (sensor for vehicle in scenario.vehicles for sensor in vehicle.sensors)
    if time.mode != "realtime" and (mistake := window_mistake(time, sensors)):
        raise UserError(f"scenario `{scenario.name}`, `time.window_ticks`: {mistake}")
    if mistake := answers_mistake(scenario):
        raise UserError(f"scenario `{scenario.name}`, {mistake}")
    return replace(scenario, time=time)


def forwarded(options: argparse.Namespace) -> list[str]:
    """Return the given options as arguments for another command."""
    given = ((field, getattr(options, field)) for field in OPTIONS)
    return [word for f, value in given if value is not None for word in (f"--{f}", str(value))]
