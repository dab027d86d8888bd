# SPDX-License-Identifier: Apache-2.0
"""`groundlink view`: show a run in Rerun or Foxglove, or a recording in Rerun.

The viewer is a separate process, ``python -m services.view``, with the same options. With other
sensors it gets their scenario, and simulates them while it shows the recording.
"""

import argparse
import os
import sys
import tempfile
from pathlib import Path

import msgspec

from groundlink.cli import Subparsers
from groundlink.core.errors import UserError
from groundlink.core.extras import needs
from groundlink.process.runner import add_run_arguments


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    # The viewer's process has the same options and loads no loader.
    from groundlink.loader import overrides

    parser = subparsers.add_parser("view", help="show a run or a recording in a viewer")
    add_run_arguments(parser)
    add_arguments(parser)
    overrides.add_argument(parser)
    overrides.add_sensor_arguments(parser)
    parser.set_defaults(command=view)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the viewer."""
    parser.add_argument(
        "recording",
        nargs="?",
        type=Path,
        metavar="RUN.mcap",
        help="recording to show instead of a run",
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--web",
        action="store_true",
        help="show in a browser; default without a display",
    )
    where.add_argument(
        "--save",
        type=Path,
        metavar="FILE.rrd",
        help="write to a file; about 8 MB/s with a VLP-16",
    )
    where.add_argument(
        "--foxglove",
        action="store_true",
        help="serve ROS 2 topics to Foxglove or Lichtblick over WebSocket",
    )
    parser.add_argument(
        "--host", default="127.0.0.1", help="address of --web and --foxglove (%(default)s)"
    )
    parser.add_argument(
        "--port", type=int, help="port of --web (default 9090) or --foxglove (default 8765)"
    )
    parser.add_argument(
        "--color",
        "--colour",  # the old spelling
        dest="color",
        choices=("intensity", "ring"),
        default="intensity",
        help="field that colors LiDAR points (%(default)s)",
    )


def view(options: argparse.Namespace) -> int:
    """Start the viewer in place of this process; with changed sensors, beside it."""
    from groundlink.cli.run.cases import exit_code
    from groundlink.loader import overrides
    from groundlink.loader.recorded_scenario import with_changes

    if options.recording and (options.connect or options.run):
        raise UserError(
            f"{options.recording}: --connect and --run do not apply to a recording. Fix: leave "
            "them out"
        )
    changes = overrides.all_changes(options)
    if not changes:
        command = _viewer(options)
        os.execv(command[0], command)
    if not options.recording:
        raise UserError(
            "view: --set, --add and --remove apply to a recording. Fix: name one, or leave them out"
        )
    with needs("record"):
        from groundlink.recording.reader import Recording

    with Recording(options.recording) as recording:
        changed = with_changes(recording.started_as, changes)
    with tempfile.TemporaryDirectory(prefix="groundlink-view-") as folder:
        scenario = Path(folder) / "scenario.msgpack"
        scenario.write_bytes(msgspec.msgpack.encode(changed))
        return exit_code([*_viewer(options), "--scenario", str(scenario)])


def _viewer(options: argparse.Namespace) -> list[str]:
    """Return the command of the viewer's process."""
    words = [str(options.recording)] if options.recording else []
    words += ["--host", options.host, "--color", options.color]
    for name in ("connect", "run", "save", "port"):
        if (value := getattr(options, name)) is not None:
            words += [f"--{name}", str(value)]
    words += [f"--{name}" for name in ("web", "foxglove") if getattr(options, name)]
    return [sys.executable, "-m", "services.view", *words]
