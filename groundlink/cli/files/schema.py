# SPDX-License-Identifier: Apache-2.0
"""`groundlink schema KIND`: print the JSON Schema of a kind of file, for editors."""

import argparse
import json

from groundlink.cli import Subparsers
from groundlink.loader.json_schema import KINDS, json_schema


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "schema", help="print the JSON Schema of a kind of file, for editors"
    )
    parser.add_argument("kind", choices=tuple(KINDS), help="kind of file")
    parser.set_defaults(command=schema)


def schema(options: argparse.Namespace) -> int:
    """Print the schema."""
    print(json.dumps(json_schema(options.kind), indent=2))
    return 0
