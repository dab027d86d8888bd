# SPDX-License-Identifier: Apache-2.0
"""`groundlink topics`: print the table of streams on the bus."""

import argparse

from groundlink.bus.core_topics import ROOT, BusTopic
from groundlink.bus.reference import reference
from groundlink.bus.topics import TOPICS
from groundlink.cli import Subparsers
from groundlink.cli.terminal.json_output import add_json_option, print_json
from groundlink.cli.terminal.output import console
from groundlink.cli.terminal.tables import Column, FittingTable

PLAIN_WIDTH = 180
"""Line width without a terminal."""


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("topics", help="list the streams of the bus")
    form = parser.add_mutually_exclusive_group()
    form.add_argument(
        "--markdown",
        action="store_true",
        help="print keys and messages as Markdown, as in docs/reference/bus.md",
    )
    add_json_option(form)
    parser.set_defaults(command=topics)


def topics(options: argparse.Namespace) -> int:
    """Print the table of topics."""
    if options.markdown:
        print(reference(), end="")
        return 0
    rows = [_facts(topic) for topic in TOPICS]
    if options.json:
        print_json(rows)
        return 0
    columns = [Column(name, "text") for name in rows[0]]
    table = FittingTable(f"keys under {ROOT}/<run>/", columns)
    for row in rows:
        table.add_row(*row.values())
    console(plain_width=PLAIN_WIDTH).print(table)
    return 0


def _facts(topic: BusTopic) -> dict[str, str]:
    """Return a stream's row of the table."""
    return {
        "stream": topic.name,
        "key": topic.key,
        "message": topic.message.__name__,
        "rate": topic.rate,
        "publisher": topic.publisher,
        "delivery": topic.delivery.value,
    }
