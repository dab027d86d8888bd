# SPDX-License-Identifier: Apache-2.0
"""`groundlink save FILE` and `restore FILE`: a run as it is now, kept and taken up again.

Rule: files are written and read where the command runs, so nobody on the bus can have physics write
or read one. What a file holds is looked at before anything is asked of a run.
"""

from __future__ import annotations

import argparse
import sys
import threading
import time
from pathlib import Path

from groundlink.bus.control_client import run_status, send_command
from groundlink.bus.queries import journal_key
from groundlink.bus.session import Bus
from groundlink.core.clock import TICK_SECONDS
from groundlink.core.errors import UserError
from groundlink.messages.control import Restore
from groundlink.process import runner as process
from groundlink.process.joining import join
from groundlink.run import journal

from .control import POLL_SECONDS, told
from .running import check_new_file

JOURNAL_SECONDS = 60.0
"""How long a journal may take to come: that of a day's run is hundreds of megabytes."""

SHOW_SECONDS = 1.0
"""Between lines of progress."""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the commands to the command line."""
    save_parser = subparsers.add_parser("save", help="write a run, as it is now, to a file")
    restore_parser = subparsers.add_parser("restore", help="let a run go on from a saved one")
    for parser, command in ((save_parser, save), (restore_parser, restore)):
        parser.add_argument("file", type=Path, metavar="FILE", help="such as half_way.run")
        parser.add_argument("--run", help="name of the run; needed only where several run")
        parser.add_argument("--connect", metavar="ENDPOINT", help="router of the run")
        parser.set_defaults(command=command)


def save(options: argparse.Namespace) -> int:
    """Write a run under way to a file."""
    check_new_file("save", options.file)
    with Bus(connect=process.endpoint(options)) as bus:
        run, _ = join(bus, options.run, threading.Event())
        content = b"".join(bus.query(journal_key(run), seconds=JOURNAL_SECONDS).values())
    if not content:
        raise UserError(
            f"physics of run `{run}` gave no journal; has the run begun, and is physics running?"
        )
    saved = journal.loaded(content, f"run `{run}`")
    journal.write(options.file, content)
    at = f"tick {saved.tick} ({saved.tick * TICK_SECONDS:.4f} s)"
    print(f"run `{run}` at {at} is in {options.file}, {len(content) / 1e6:.1f} MB")
    return 0


def restore(options: argparse.Namespace) -> int:
    """Let a run under way go on from where a saved one was."""
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
        raise UserError(f"run `{run}`: {answer.failure}; the run is as it was")
    if answer.warning:
        print(f"groundlink: {answer.warning}", file=sys.stderr)
    print(told(run, answer))
    return 0
