# SPDX-License-Identifier: Apache-2.0
"""`groundlink topics`: the table of everything that is said on the bus."""

from __future__ import annotations

import argparse

from rich.console import Console
from rich.table import Table

from groundlink.topics import ROOT, TOPICS


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("topics", help="list the streams of the bus")
    parser.set_defaults(command=topics)


def topics(options: argparse.Namespace) -> int:
    """Print the table of topics."""
    table = Table(title=f"keys under {ROOT}/<run>/", title_justify="left", box=None)
    for column in ("stream", "key", "message", "rate", "publisher", "delivery"):
        table.add_column(column, no_wrap=True)
    for topic in TOPICS:
        table.add_row(
            topic.name,
            topic.key,
            topic.message.__name__,
            topic.rate,
            topic.publisher,
            topic.delivery.value,
        )
    Console(width=None if Console().is_terminal else 120).print(table)
    return 0
