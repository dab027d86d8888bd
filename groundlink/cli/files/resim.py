# SPDX-License-Identifier: Apache-2.0
"""`groundlink resim RUN.mcap SCENARIO --out OTHER.mcap`: a recorded drive with other sensors.

Physics repeats the journal of the recording, and the sensors that differ from the recorded ones
follow it. Their readings take the place of the recorded ones; all else is copied.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from groundlink.cli import Subparsers
from groundlink.cli.run import running
from groundlink.cli.terminal import output as terminal
from groundlink.cli.terminal.progress import progress
from groundlink.core.atomic_file import check_new_file
from groundlink.core.extras import needs
from groundlink.loader import load, overrides
from groundlink.loader.recorded_scenario import with_changes

if TYPE_CHECKING:
    from groundlink.recording.repeated_run import Resimulated


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "resim", help="simulate the sensors of a recorded run again, with changes"
    )
    parser.add_argument("recording", type=Path, metavar="RUN.mcap", help="recording to read")
    parser.add_argument(
        "scenario",
        nargs="?",
        help=f"{running.SCENARIO_HELP} (default: that of the recording)",
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="OTHER.mcap", help="file to write"
    )
    overrides.add_argument(parser)
    overrides.add_sensor_arguments(parser)
    parser.set_defaults(command=resim)


def resim(options: argparse.Namespace) -> int:
    """Write the recording as it is with the scenario's sensors, weather and light."""
    console = terminal.console()
    check_new_file("--out", options.out)
    changes = overrides.all_changes(options)
    done = write_resimulated(options.recording, changes, options.out, options.scenario)
    if done.is_copy:
        terminal.say(console, f"nothing differs: {options.out} is a copy")
        return 0
    names = ", ".join(done.sensors) or "no sensor"
    terminal.say(
        console,
        f"wrote {options.out}: {done.new} messages simulated ({names}), {done.copied} copied",
    )
    return 0


def write_resimulated(
    recorded: Path, changes: Sequence[overrides.Change], out: Path, scenario: str | None = None
) -> Resimulated:
    """Write a recording with changes of its scenario, or of another one, to a new file."""
    with needs("record"):
        from groundlink.recording.reader import Recording
        from groundlink.recording.repeated_run import resimulate

    with Recording(recorded) as recording, progress(f"simulating {recorded} again") as show:
        if scenario is None:
            changed = with_changes(recording.started_as, changes)
        else:
            changed = load(scenario, changes=changes)
        return resimulate(recording, changed, out, show=show)
