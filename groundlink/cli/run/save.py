# SPDX-License-Identifier: Apache-2.0
"""`groundlink save FILE` and `restore FILE`: write the state of a run to a file, and restore it.

Files are read and written by the command, never by physics, so nobody on the bus gains access to
files. The command checks a file before it sends anything.
"""

import argparse
import sys
import threading
import time
from pathlib import Path

from groundlink.bus.control_client import fetch_journal, run_status, send_command
from groundlink.bus.session import Bus
from groundlink.cli import Subparsers
from groundlink.core.clock import TICK_SECONDS
from groundlink.core.errors import UserError
from groundlink.episode import journal
from groundlink.episode.control import Restore
from groundlink.process import runner as process
from groundlink.process.joining import join

from .control import POLL_SECONDS, status_line
from .running import check_new_file

SHOW_SECONDS = 1.0
"""Period of progress lines."""


def add_parser(subparsers: Subparsers) -> None:
    """Add the commands to the command line."""
    save_parser = subparsers.add_parser("save", help="save the state of a run to a file")
    restore_parser = subparsers.add_parser("restore", help="restore the state of a run from a file")
    for parser, command in ((save_parser, save), (restore_parser, restore)):
        parser.add_argument("file", type=Path, metavar="FILE", help="such as half_way.run")
        process.add_run_arguments(parser)
        parser.set_defaults(command=command)


def save(options: argparse.Namespace) -> int:
    """Save the state of a run to a file."""
    check_new_file("save", options.file)
    with Bus(connect=process.endpoint(options)) as bus:
        run, _ = join(bus, options.run, threading.Event())
        content = fetch_journal(bus, run)
    saved = journal.loaded(content, f"run `{run}`")
    journal.write(options.file, content)
    at = f"tick {saved.tick} ({saved.tick * TICK_SECONDS:.4f} s)"
    print(f"run `{run}`: saved {at} to {options.file}, {len(content) / 1e6:.1f} MB")
    return 0


def restore(options: argparse.Namespace) -> int:
    """Restore the state of a run from a file."""
    content = journal.read(options.file)
    journal.loaded(content, str(options.file))
    with Bus(connect=process.endpoint(options)) as bus:
        run, _ = join(bus, options.run, threading.Event())
        answer = send_command(bus, run, Restore(), content=content)
        shown = time.monotonic()
        while answer.restoring_to >= 0:
            if time.monotonic() - shown >= SHOW_SECONDS:
                shown = time.monotonic()
                print(f"restoring: tick {answer.tick} of {answer.restoring_to}", flush=True)
            time.sleep(POLL_SECONDS)
            answer = run_status(bus, run)
    if answer.failure:
        raise UserError(f"run `{run}`: {answer.failure}; the run is unchanged")
    if answer.warning:
        print(f"groundlink: warning: {answer.warning}", file=sys.stderr)
    print(status_line(run, answer))
    return 0
