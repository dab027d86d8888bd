# SPDX-License-Identifier: Apache-2.0
"""`groundlink link`: a relay that is a bad link, or a change of the link in a run.

Rule: the relay is a process of its own, started as ``python -m services.link``.
"""

from __future__ import annotations

import argparse
import os
import sys

import msgspec

from groundlink.bus.queries import link_key
from groundlink.bus.session import Bus
from groundlink.core.errors import UserError
from groundlink.emulation.arguments import add_arguments, command_line, impairments
from groundlink.process import runner as process

ANSWER_SECONDS = 3.0
"""How long the gateway may take to answer."""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "link", help="relay datagrams over a bad link, or change the link of a run"
    )
    add_arguments(parser)
    parser.add_argument("--json", action="store_true", help="tell the relay's counters as JSON")
    run = parser.add_argument_group("instead of a relay, the link in the gateway of a run")
    run.add_argument("--run", help="name of the run")
    run.add_argument("--connect", metavar="ENDPOINT", help="router of the run")
    run.add_argument(
        "--set",
        action="append",
        metavar="DIRECTION.FIELD=VALUE",
        help="such as to_ros.loss=0.1 or from_ros.outage=true; may be repeated",
    )
    parser.set_defaults(command=link)


def link(options: argparse.Namespace) -> int:
    """Become the relay, or change a run's link and print what it is now."""
    if options.run is None:
        if options.set:
            raise UserError("--set changes the link of a run; name it with --run")
        impairments(options)
        if options.listen is None or options.to is None:
            raise UserError("expected --listen HOST:PORT and --to HOST:PORT, or --run NAME")
        words = command_line(options) + (["--json"] if options.json else [])
        os.execv(sys.executable, [sys.executable, "-m", "services.link", *words])
    with Bus(connect=process.endpoint(options)) as bus:
        wish = ";".join(options.set or ())
        replies = bus.query(link_key(options.run), wish, seconds=ANSWER_SECONDS)
    if not replies:
        raise UserError(
            f"run `{options.run}` has no emulated link; add `link: {{}}` to the scenario's gateway"
        )
    error, settings = msgspec.json.decode(
        next(iter(replies.values())), type=tuple[str, dict[str, dict[str, float | bool]]]
    )
    if error:
        raise UserError(error)
    for direction, fields in settings.items():
        print(f"{direction}: " + ", ".join(f"{name} {value}" for name, value in fields.items()))
    return 0
