# SPDX-License-Identifier: Apache-2.0
"""`groundlink schema KIND`: print the JSON Schema of a kind of file, for editors."""

from __future__ import annotations

import argparse
import json

from groundlink.loader.json_schema import KINDS, json_schema


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "schema", help="print the JSON Schema of a kind of file, for editors"
    )
    parser.add_argument("kind", choices=KINDS, help="kind of file")
    parser.set_defaults(command=schema)


def schema(options: argparse.Namespace) -> int:
    """Print the schema."""
    print(json.dumps(json_schema(options.kind), indent=2))
    return 0
