# SPDX-License-Identifier: Apache-2.0
"""Option `--json` of commands, and what it prints.

Keys are those of `groundlink top --json` and of reports: units in names, `tick` and `sim_seconds`
for times of a run. Progress, log lines and warnings go to stderr.
"""

import argparse
import json

import msgspec


def add_json_option(
    parser: argparse._ActionsContainer, text: str = "print JSON instead of text"
) -> None:
    """Add the option to a command."""
    parser.add_argument("--json", action="store_true", help=text)


def print_json(content: object, *, indent: int | None = 2) -> None:
    """Print plain data or structs as JSON; None for `indent` prints one line."""
    print(json.dumps(msgspec.to_builtins(content), indent=indent), flush=True)
