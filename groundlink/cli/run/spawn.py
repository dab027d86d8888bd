# SPDX-License-Identifier: Apache-2.0
"""`groundlink spawn` and `remove`: add objects to a run, and remove them.

The command reads the files; physics receives their content and checks for free space.
"""

import argparse
import sys

from groundlink.bus.control_client import send_command
from groundlink.cli import Subparsers
from groundlink.cli.terminal.json_output import add_json_option, print_json
from groundlink.core.errors import UserError
from groundlink.episode.control import ControlAnswer, Remove, Spawn
from groundlink.loader.additions import KINDS, SpawnPlace, addition_to, check_addition
from groundlink.process import runner as process
from groundlink.process.joining import join_world

from .connection import at_tick, joined, tick_text


def add_parser(subparsers: Subparsers) -> None:
    """Add the commands to the command line."""
    put = subparsers.add_parser("spawn", help="add a vehicle or an obstacle to a run")
    put.add_argument(
        "what",
        metavar="FILE.yaml|KIND",
        help=f"a vehicle, a world with solids or actors, or one of {', '.join(KINDS)}",
    )
    put.add_argument("--name", help="name in the run (default: derived from WHAT)")
    put.add_argument(
        "--at",
        metavar="X,Y[,Z[,YAW]]",
        default="0,0",
        help="position in meters, z above the ground, yaw in degrees; --at=-1,2 for a negative x",
    )
    put.set_defaults(command=spawn)
    take = subparsers.add_parser("remove", help="remove a vehicle or an obstacle from a run")
    take.add_argument(
        "name",
        help="name of a vehicle, actor or solid; if there is none, the solids whose names begin "
        "with NAME and `_`",
    )
    take.set_defaults(command=remove)
    for parser in (put, take):
        process.add_run_arguments(parser)
        add_json_option(parser)


def spawn(options: argparse.Namespace) -> int:
    """Add an object to a run."""
    at = _place(options.at)
    check_addition(options.what)
    with joined(options, joining=join_world) as (bus, run, scenario):
        name, more = addition_to(
            scenario,
            options.what,
            at=at,
            name=options.name,
            warn=lambda line: print(line, file=sys.stderr),
        )
        answer = send_command(bus, run, Spawn(more))
    _print_change(run, "added", name, answer, as_json=options.json)
    return 0


def remove(options: argparse.Namespace) -> int:
    """Remove an object from a run."""
    with joined(options) as (bus, run, _):
        answer = send_command(bus, run, Remove(options.name))
    _print_change(run, "removed", options.name, answer, as_json=options.json)
    return 0


def _print_change(
    run: str, change: str, name: str, answer: ControlAnswer, *, as_json: bool
) -> None:
    """Print a change of the world, in effect from the next tick."""
    tick = answer.tick + 1
    if as_json:
        print_json(at_tick(run, tick, **{change: name}))
    else:
        print(f"run `{run}`: {change} `{name}` at {tick_text(tick)}")


def _place(text: str) -> SpawnPlace:
    try:
        numbers = [float(part) for part in text.split(",")]
        if not 2 <= len(numbers) <= 4 or not all(abs(number) < 1e9 for number in numbers):
            raise ValueError
    except ValueError:
        raise UserError(f"--at {text}: expected X,Y or X,Y,Z or X,Y,Z,YAW") from None
    return SpawnPlace(*numbers)
