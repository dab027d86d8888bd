# SPDX-License-Identifier: Apache-2.0
"""Table of commands in groups, and the parser of the command line."""

import argparse

from groundlink.core import VERSION

from .bisect import command as bisect
from .expectations import judge
from .files import (
    check,
    completion,
    compose,
    convert,
    explain,
    export,
    new,
    report,
    resim,
    schema,
    secure,
    snapshot,
    topics,
    try_vehicle,
    verify,
    view,
    world,
)
from .run import (
    control,
    demo,
    drive,
    fault,
    link,
    record,
    replay,
    save,
    seek,
    spawn,
    sweep,
    top,
    up,
)
from .search import campaign, search, worker
from .sheets import fit, sensors

GROUPS = {
    "start a run": (demo, up, record, replay, snapshot, sweep, search, campaign, worker, bisect),
    "look at a run": (top, view),
    "control a run": (drive, control, save, seek, spawn, fault, link),
    "use a recording": (report, judge, verify, resim, export, convert, fit),
    "write a scenario": (new, check, try_vehicle, explain, sensors, topics, schema, world),
    "set up": (compose, secure, completion),
}
"""Modules of the commands, in the order and under the titles of `groundlink --help`."""


PROGRAM = "groundlink"

GREETING = """\
Groundlink: a real-time test rig for unmanned ground vehicles

  groundlink demo                              look first; Ctrl-C ends it
  groundlink up indoor_lab                     run a scenario for your ROS nodes
  groundlink drive                             drive its vehicle by keys
  groundlink record indoor_lab --out run.mcap  record 30 s with ground truth
  groundlink new my_scenario                   write a scenario of your own

groundlink --help lists all commands.
"""


def parser() -> argparse.ArgumentParser:
    """Return the parser; `command` of its options is the function to call with them."""
    parser = argparse.ArgumentParser(
        prog=PROGRAM,
        description="A distributed real-time test rig for unmanned ground vehicles.",
        add_help=False,
    )
    parser.set_defaults(command=_greet)
    subparsers = parser.add_subparsers(metavar="COMMAND")
    # argparse would list all commands in one group.
    parser._positionals._group_actions.remove(subparsers)
    for title, modules in GROUPS.items():
        listed = len(subparsers._choices_actions)
        for module in modules:
            module.add_parser(subparsers)
        group = parser.add_argument_group(title)
        group._group_actions += subparsers._choices_actions[listed:]
    options = parser.add_argument_group("options")
    options.add_argument("-h", "--help", action="help", help="show this help message and exit")
    options.add_argument("--version", action="version", version=f"{PROGRAM} {VERSION}")
    return parser


def _greet(options: argparse.Namespace) -> int:
    print(GREETING, end="")
    return 0
