# SPDX-License-Identifier: Apache-2.0
"""`groundlink demo`: a first look, without ROS: a rover drives by itself, shown in a viewer."""

import argparse

from groundlink.cli import Subparsers
from groundlink.core.extras import check_installed

from . import up

SCENARIO = "indoor_lab_tour"

NOT_AS_REQUIRED = 1
"""Exit code of `groundlink up` after a missed rate, say on a slow machine."""

PACKAGES = ("pybullet", "rosbags", "udp_bridge", "rerun")
"""Packages of the extras that the processes of the demo need."""


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "demo", help="first look: a rover drives through a laboratory, shown in a viewer"
    )
    parser.add_argument(
        "--duration",
        type=float,
        metavar="S",
        help="stop after S seconds of sim time (default: at Ctrl-C)",
    )
    parser.set_defaults(command=demo)


def demo(options: argparse.Namespace) -> int:
    """Run `groundlink up` with a viewer; return its exit code, but 0 if only a rate was missed.

    A demo on a slow machine has shown what it is for.
    """
    check_installed(PACKAGES, "all")
    words = ["up", SCENARIO, "--view"]
    if options.duration is not None:
        words += ["--duration", f"{options.duration:g}"]
    print(f"demo: the same as `groundlink {' '.join(words)}`; Ctrl-C ends it", flush=True)
    parser = argparse.ArgumentParser()
    up.add_parser(parser.add_subparsers())
    code = up.up(parser.parse_args(words))
    return 0 if code == NOT_AS_REQUIRED else code
