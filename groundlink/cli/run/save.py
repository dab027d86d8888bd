# SPDX-License-Identifier: Apache-2.0
"""`groundlink save FILE` and `restore FILE`: write the state of a run to a file, and restore it.

Files are read and written by the command, never by physics, so nobody on the bus gains access to
files. The command checks a file before it sends anything.
"""

import argparse
import sys
from pathlib import Path

from groundlink.bus.control_client import fetch_journal, restoring
from groundlink.cli import Subparsers
from groundlink.cli.terminal.json_output import add_json_option, print_json
from groundlink.cli.terminal.progress import progress
from groundlink.core.atomic_file import check_new_file
from groundlink.episode import journal
from groundlink.process import runner as process

from .connection import at_tick, joined, tick_text
from .control import print_status


def add_parser(subparsers: Subparsers) -> None:
    """Add the commands to the command line."""
    save_parser = subparsers.add_parser("save", help="save the state of a run to a file")
    restore_parser = subparsers.add_parser("restore", help="restore the state of a run from a file")
    for parser, command in ((save_parser, save), (restore_parser, restore)):
        parser.add_argument("file", type=Path, metavar="FILE", help="such as half_way.run")
        process.add_run_arguments(parser)
        add_json_option(parser)
        parser.set_defaults(command=command)


def save(options: argparse.Namespace) -> int:
    """Save the state of a run to a file."""
    check_new_file("save", options.file)
    with joined(options) as (bus, run, _), progress(f"run `{run}`: fetching its journal"):
        content = fetch_journal(bus, run)
    saved = journal.loaded(content, f"run `{run}`")
    journal.write(options.file, content)
    if options.json:
        print_json(at_tick(run, saved.tick, path=str(options.file), bytes=len(content)))
    else:
        size = f"{len(content) / 1e6:.1f} MB"
        print(f"run `{run}`: saved {tick_text(saved.tick)} to {options.file}, {size}")
    return 0


def restore(options: argparse.Namespace) -> int:
    """Restore the state of a run from a file."""
    content = journal.read(options.file)
    journal.loaded(content, str(options.file))
    with joined(options) as (bus, run, _), progress(f"restoring {options.file.name}") as done:
        for answer in restoring(bus, run, content):
            if answer.restoring_to >= 0:
                done(answer.tick / max(answer.restoring_to, 1))
    if answer.warning:
        print(f"groundlink: warning: {answer.warning}", file=sys.stderr)
    print_status(run, answer, as_json=options.json)
    return 0
