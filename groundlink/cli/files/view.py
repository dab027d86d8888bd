# SPDX-License-Identifier: Apache-2.0
"""`groundlink view`: show a run that goes on in Rerun or Foxglove, or a recording in Rerun.

Rule: the viewer is a process of its own, started as ``python -m services.view``; it reads the same
options.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

from groundlink.core.errors import UserError


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("view", help="show a run that goes on, or a recording")
    parser.add_argument(
        "--connect", metavar="ENDPOINT", help="router of the run, such as tcp/HOST:7447"
    )
    parser.add_argument("--run", help="name of the run; needed only where several run")
    add_arguments(parser)
    parser.set_defaults(command=view)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what the viewer can be told."""
    parser.add_argument(
        "recording",
        nargs="?",
        type=Path,
        metavar="RUN.mcap",
        help="a recording to show whole, instead of a run that goes on",
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--web",
        action="store_true",
        help="show it in a browser, as is done where there's no screen",
    )
    where.add_argument(
        "--save",
        type=Path,
        metavar="FILE.rrd",
        help="write it into a file, about 8 MB/s with a VLP-16",
    )
    where.add_argument(
        "--foxglove",
        action="store_true",
        help="serve it to Foxglove or Lichtblick as ROS 2 topics over WebSocket",
    )
    parser.add_argument(
        "--host", default="127.0.0.1", help="where --web and --foxglove listen (%(default)s)"
    )
    parser.add_argument(
        "--port", type=int, help="of --web (default 9090) or --foxglove (default 8765)"
    )
    parser.add_argument(
        "--colour",
        choices=("intensity", "ring"),
        default="intensity",
        help="what LiDAR points are coloured by (%(default)s)",
    )


def view(options: argparse.Namespace) -> int:
    """Become the viewer."""
    if options.recording and (options.connect or options.run):
        raise UserError(
            f"{options.recording}: a recording is read as it is; expected no --connect and no --run"
        )
    words = [str(options.recording)] if options.recording else []
    words += ["--host", options.host, "--colour", options.colour]
    for name in ("connect", "run", "save", "port"):
        if (value := getattr(options, name)) is not None:
            words += [f"--{name}", str(value)]
    words += [f"--{name}" for name in ("web", "foxglove") if getattr(options, name)]
    os.execv(sys.executable, [sys.executable, "-m", "services.view", *words])
