# SPDX-License-Identifier: Apache-2.0
"""`groundlink topics`: print the table of streams on the bus."""

import argparse

from rich.console import Console

from groundlink.bus.core_topics import ROOT
from groundlink.bus.reference import reference
from groundlink.bus.topics import TOPICS
from groundlink.cli import Subparsers
from groundlink.cli.terminal.tables import Column, FittingTable

WIDTH = 180
"""Line width without a terminal."""


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("topics", help="list the streams of the bus")
    parser.add_argument(
        "--markdown",
        action="store_true",
        help="print keys and messages as Markdown, as in docs/reference/bus.md",
    )
    parser.set_defaults(command=topics)


def topics(options: argparse.Namespace) -> int:
    """Print the table of topics."""
    if options.markdown:
        print(reference(), end="")
        return 0
    table = FittingTable(
        f"keys under {ROOT}/<run>/",
        (
            Column("stream", "text"),
            *(Column(name, "text") for name in ("key", "message", "rate", "publisher", "delivery")),
        ),
    )
    for topic in TOPICS:
        table.add_row(
            topic.name,
            topic.key,
            topic.message.__name__,
            topic.rate,
            topic.publisher,
            topic.delivery.value,
        )
    Console(width=None if Console().is_terminal else WIDTH).print(table)
    return 0
