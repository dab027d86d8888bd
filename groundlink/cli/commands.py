# SPDX-License-Identifier: Apache-2.0
"""Table of commands and parser of the command line."""

import argparse

from groundlink.core import VERSION

from .files import (
    check,
    compose,
    convert,
    explain,
    export,
    report,
    schema,
    secure,
    sensors,
    snapshot,
    topics,
    verify,
    view,
    world,
)
from .run import control, drive, fault, link, record, replay, save, spawn, sweep, top, up

COMMANDS = (
    up,
    record,
    replay,
    convert,
    export,
    verify,
    report,
    top,
    drive,
    control,
    save,
    spawn,
    fault,
    check,
    sensors,
    schema,
    explain,
    topics,
    link,
    view,
    snapshot,
    world,
    compose,
    secure,
    sweep,
)


GREETING = """\
Groundlink: a real-time test rig for unmanned ground vehicles

  groundlink up indoor_lab                     run it; Ctrl-C ends it
  groundlink drive                             drive the vehicle by keys
  groundlink view                              see the run in three dimensions
  groundlink record indoor_lab --out run.mcap  record 30 s with ground truth
  groundlink check my_scenario.yaml            find mistakes before a run

groundlink --help lists all commands.
"""


def parser() -> argparse.ArgumentParser:
    """Return the parser; `command` of its options is the function to call with them."""
    parser = argparse.ArgumentParser(
        prog="groundlink",
        description="A distributed real-time test rig for unmanned ground vehicles.",
    )
    parser.add_argument("--version", action="version", version=f"groundlink {VERSION}")
    parser.set_defaults(command=_greet)
    subparsers = parser.add_subparsers(metavar="COMMAND")
    for command in COMMANDS:
        command.add_parser(subparsers)
    return parser


def _greet(options: argparse.Namespace) -> int:
    print(GREETING, end="")
    return 0
