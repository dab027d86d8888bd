# SPDX-License-Identifier: Apache-2.0
"""All commands, and the parser of the command line."""

from __future__ import annotations

import argparse

from groundlink import __version__

from .files import (
    check,
    compose,
    convert,
    report,
    schema,
    secure,
    sensors,
    snapshot,
    topics,
    verify,
    view,
    world,
)
from .run import control, drive, fault, link, record, replay, save, spawn, sweep, top, up

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


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line; `command` is what to call with its options."""
    parser = argparse.ArgumentParser(
        prog="groundlink", description="A distributed real-time test rig for ground vehicles."
    )
    parser.add_argument("--version", action="version", version=f"groundlink {__version__}")
    subparsers = parser.add_subparsers(required=True, metavar="COMMAND")
    for command in COMMANDS:
        command.add_parser(subparsers)
    return parser
