# SPDX-License-Identifier: Apache-2.0
"""`groundlink seek RUN.mcap --at S`: put a run at an instant of a recorded one, paused.

The recording is read by the command. Physics continues from the last checkpoint before that instant
and steps the rest; the processes of the run stay.
"""

import argparse
import time
from pathlib import Path

from groundlink.bus.control_client import restoring, send_command
from groundlink.cli import Subparsers
from groundlink.cli.terminal.json_output import add_json_option, print_json
from groundlink.cli.terminal.progress import progress
from groundlink.core.extras import needs
from groundlink.episode import journal
from groundlink.episode.control import Pause
from groundlink.process import runner as process

from .connection import at_tick, joined, tick_text


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("seek", help="put a run at an instant of a recorded run")
    parser.add_argument("recording", type=Path, metavar="RUN.mcap", help="recording to read")
    add_instant(parser, required=True)
    process.add_run_arguments(parser)
    add_json_option(parser)
    parser.set_defaults(command=seek)


def add_instant(parser: argparse.ArgumentParser, *, required: bool, help_text: str = "") -> None:
    """Add the option for an instant of a recording."""
    parser.add_argument(
        "--at",
        type=float,
        required=required,
        metavar="S",
        help=help_text or "sim time since the start of the recorded run, in seconds",
    )


def seek(options: argparse.Namespace) -> int:
    """Put a run that is up at an instant, and print its state."""
    started = time.monotonic()
    content = saved_run(options.recording, options.at)
    with joined(options) as (bus, run, _), progress(f"seeking {options.at:g} s") as done:
        send_command(bus, run, Pause())
        begun = -1
        for answer in restoring(bus, run, content):
            begun = answer.tick if begun < 0 else begun
            if answer.restoring_to >= 0:
                done((answer.tick - begun) / max(answer.restoring_to - begun, 1))
    seconds = time.monotonic() - started
    if options.json:
        print_json(at_tick(run, answer.tick, paused=answer.paused, wall_seconds=seconds))
    else:
        print(f"run `{run}` is paused at {tick_text(answer.tick)}, after {seconds:.2f} s")
    return 0


def saved_run(recording: Path, seconds: float) -> bytes:
    """Return an instant of a recorded run as the content of a saved run.

    Raises
    ------
    UserError
        when it is outside of the recording, or the recording has no checkpoints.
    """
    with needs("record"):
        from groundlink.recording.reader import Recording
        from groundlink.recording.seeking import journal_at

    with Recording(recording) as opened:
        return journal.dumped(journal_at(opened, seconds))
