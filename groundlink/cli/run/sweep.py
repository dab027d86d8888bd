# SPDX-License-Identifier: Apache-2.0
"""`groundlink sweep EXPERIMENT --vary SENSOR.FIELD=[...]`: repeat an experiment with variations.

Passes its arguments to the experiments, which are not part of the package: they require a clone of
the repository and third-party programs.
"""

import argparse
import os
import subprocess
import sys
from pathlib import Path

from groundlink.cli import Subparsers
from groundlink.core.errors import UserError

MODULE = "experiments.studies.sweep"
REPOSITORY = Path(__file__).resolve().parents[3]
NO_PREFIX = "\0"
"""Starts no option: all arguments belong to the module, `--help` too."""


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "sweep",
        help="repeat an experiment with varied sensors and mounts; print a table of errors",
        add_help=False,
        prefix_chars=NO_PREFIX,
    )
    parser.add_argument("words", nargs="*")
    parser.set_defaults(command=sweep)


def sweep(options: argparse.Namespace) -> int:
    """Run the sweep; return its exit code."""
    if not (REPOSITORY / "experiments").is_dir():
        raise UserError(
            "sweep: the experiments are not installed. Fix: run it in a clone of the repository"
        )
    command = [sys.executable, "-m", MODULE, *options.words]
    path = os.pathsep.join(filter(None, (str(REPOSITORY), os.environ.get("PYTHONPATH"))))
    try:
        return subprocess.run(
            command, env=os.environ | {"PYTHONPATH": path}, check=False
        ).returncode
    except KeyboardInterrupt:
        return 130
