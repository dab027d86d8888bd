# SPDX-License-Identifier: Apache-2.0
"""`groundlink demo`: a first look, without ROS: a rover drives by itself, shown in a viewer."""

import argparse

from groundlink.cli import Subparsers
from groundlink.core.extras import check_installed

from . import up

SCENARIO = "indoor_lab_tour"

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
    """Run `groundlink up` with a viewer."""
    check_installed(PACKAGES, "all")
    words = ["up", SCENARIO, "--view"]
    if options.duration is not None:
        words += ["--duration", f"{options.duration:g}"]
    print(f"demo: the same as `groundlink {' '.join(words)}`; Ctrl-C ends it", flush=True)
    parser = argparse.ArgumentParser()
    up.add_parser(parser.add_subparsers())
    return up.up(parser.parse_args(words))
