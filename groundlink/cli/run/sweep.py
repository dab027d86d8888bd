# SPDX-License-Identifier: Apache-2.0
"""`groundlink sweep EXPERIMENT --vary SENSOR.FIELD=[...]`: an experiment over sensors and mounts.

Rule: only hands its words on, as experiments lie outside of the package: they need a clone of the
repository, and programs of others in environments of their own.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path

from groundlink.core.errors import UserError

MODULE = "experiments.studies.sweep"
REPOSITORY = Path(__file__).resolve().parents[3]
NO_PREFIX = "\0"
"""Begins no option: all words are the module's, `--help` too."""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "sweep",
        help="repeat an experiment over sensors and mounts, table errors",
        add_help=False,
        prefix_chars=NO_PREFIX,
    )
    parser.add_argument("words", nargs="*")
    parser.set_defaults(command=sweep)


def sweep(options: argparse.Namespace) -> int:
    """Run the sweep; return its exit code.

    Raises
    ------
    UserError
        when the experiments are not here.
    """
    if not (REPOSITORY / "experiments").is_dir():
        raise UserError(
            "sweep: there are no experiments here; run it in a clone of Groundlink's repository"
        )
    command = [sys.executable, "-m", MODULE, *options.words]
    path = os.pathsep.join(filter(None, (str(REPOSITORY), os.environ.get("PYTHONPATH"))))
    try:
        return subprocess.run(
            command, env=os.environ | {"PYTHONPATH": path}, check=False
        ).returncode
    except KeyboardInterrupt:
        return 130
