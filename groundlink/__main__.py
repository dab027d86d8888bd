# SPDX-License-Identifier: Apache-2.0
"""The command `groundlink`: finds the subcommand, prints a user's mistake as one line."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from . import __version__
from .cli import (
    check,
    compose,
    control,
    convert,
    drive,
    fault,
    link,
    record,
    replay,
    report,
    save,
    schema,
    secure,
    sensors,
    snapshot,
    spawn,
    sweep,
    top,
    topics,
    up,
    verify,
    view,
    world,
)
from .errors import UserError

COMMANDS = (
    up,
    record,
    replay,
    convert,
    verify,
    report,
    top,
    drive,
    control,
    save,
    spawn,
    fault,
    check,
    sensors,
    schema,
    topics,
    link,
    view,
    snapshot,
    world,
    compose,
    secure,
    sweep,
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; return its exit code: that of the error where the user can mend it."""
    parser = argparse.ArgumentParser(
        prog="groundlink", description="A distributed real-time test rig for ground vehicles."
    )
    parser.add_argument("--version", action="version", version=f"groundlink {__version__}")
    subparsers = parser.add_subparsers(required=True, metavar="COMMAND")
    for command in COMMANDS:
        command.add_parser(subparsers)
    options = parser.parse_args(arguments)
    try:
        code: int = options.command(options)
    except UserError as error:
        print(f"groundlink: {error}", file=sys.stderr)
        return error.exit_code
    except BrokenPipeError:
        return 0  # the reader of our output has seen enough
    return code


if __name__ == "__main__":
    sys.exit(main())
