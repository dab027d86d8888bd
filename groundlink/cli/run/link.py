# SPDX-License-Identifier: Apache-2.0
"""`groundlink link`: relay datagrams with impairments, or change the emulated link of a run.

The relay is a separate process: ``python -m services.link``.
"""

import argparse
import os
import sys

import msgspec

from groundlink.bus.queries import link_key
from groundlink.bus.session import Bus
from groundlink.cli import Subparsers
from groundlink.cli.terminal.json_output import add_json_option, print_json
from groundlink.core.errors import UserError
from groundlink.emulation.arguments import add_arguments, command_line, impairments
from groundlink.process import runner as process

ANSWER_SECONDS = 3.0
"""Timeout of the gateway."""


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "link", help="relay datagrams with impairments, or change the emulated link of a run"
    )
    add_arguments(parser)
    add_json_option(parser, "print the counters of the relay, or the link of the run, as JSON")
    run = parser.add_argument_group("change the emulated link of a run instead")
    run.add_argument("--run", help="name of the run")
    run.add_argument("--connect", metavar="ENDPOINT", help="router of the run")
    run.add_argument(
        "--set",
        action="append",
        metavar="DIRECTION.FIELD=VALUE",
        help="such as to_ros.loss=0.1 or from_ros.outage=true; repeatable",
    )
    parser.set_defaults(command=link)


def link(options: argparse.Namespace) -> int:
    """Start the relay in place of this process, or change and print the link of a run."""
    if options.run is None:
        if options.set:
            raise UserError("--set: expected --run NAME as well, the run whose link is changed")
        impairments(options)
        if options.listen is None or options.to is None:
            raise UserError("expected --listen HOST:PORT and --to HOST:PORT, or --run NAME")
        words = command_line(options) + (["--json"] if options.json else [])
        os.execv(sys.executable, [sys.executable, "-m", "services.link", *words])
    with Bus(connect=process.endpoint(options)) as bus:
        changes = ";".join(options.set or ())
        replies = bus.query(link_key(options.run), changes, seconds=ANSWER_SECONDS)
    if not replies:
        raise UserError(
            f"run `{options.run}`: no emulated link. Fix: add `link: {{}}` to the scenario's "
            "gateway"
        )
    error, settings = msgspec.json.decode(
        next(iter(replies.values())), type=tuple[str, dict[str, dict[str, float | bool]]]
    )
    if error:
        raise UserError(error)
    if options.json:
        print_json({"run": options.run, "settings": settings})
        return 0
    for direction, fields in settings.items():
        print(f"{direction}: " + ", ".join(f"{name} {value}" for name, value in fields.items()))
    return 0
