# SPDX-License-Identifier: Apache-2.0
"""Options and further processes of commands that start a run on this machine."""

import argparse
import importlib.util
from collections.abc import Iterable
from ipaddress import ip_address
from pathlib import Path

from rich.console import Console

from groundlink.bus import core_topics
from groundlink.bus.zenoh_config import DEFAULT_ENDPOINT
from groundlink.cli.terminal.progress import progress
from groundlink.core.errors import RequirementError
from groundlink.core.extras import check_installed
from groundlink.loader import load
from groundlink.loader.overrides import Change
from groundlink.monitor.process_commands import joining
from groundlink.process.runner import address
from groundlink.scenario import Scenario
from groundlink.scenario.ros_side import GatewaySettings

RECORDER = core_topics.RECORDER

VIEWER = "view"
"""Name of the viewer's process."""

ROS_SIDE = "ros"
"""Name of the ROS node's process."""

SCENARIO_HELP = "scenario file (YAML), or name of a shipped scenario such as indoor_lab"


def add_arguments(parser: argparse.ArgumentParser, whose: str, *, ros: bool = True) -> None:
    """Add the options of a new run: its name, by default that of `whose`, its router, its ROS."""
    parser.add_argument("--run", help=f"name of the run (default: the {whose})")
    parser.add_argument(
        "--listen",
        metavar="ENDPOINT",
        default=DEFAULT_ENDPOINT,
        help="endpoint of the run's router (%(default)s)",
    )
    if ros:
        parser.add_argument(
            "--no-ros", action="store_true", help="do not start a ROS node; it runs elsewhere"
        )


def load_scenario(given: str | Path, changes: Iterable[Change] = ()) -> Scenario:
    """Return the scenario of a file or of a shipped name; large meshes take seconds."""
    with progress(f"loading {given}"):
        return load(given, changes=changes)


def viewer(run: str, endpoint: str) -> list[str]:
    """Return the command line of a viewer: a window, or a page for a browser without a display.

    Raises
    ------
    RequirementError
        if the extra `view` is not installed.
    """
    check_installed(("rerun", "rosbags", "PIL"), "view")
    return ["-m", "services.view", *joining(run, endpoint)]


def ros_side(gateway: GatewaySettings, shown: Console) -> list[str]:
    """Return the command line of the ROS 2 node, or of a plain receiver without ROS 2."""
    bind = ["--bind", gateway.peer]
    receives, sends = (address(text)[0] for text in (gateway.peer, gateway.bind))
    if not ip_address(receives).is_loopback:
        # A socket bound to all addresses sends to its own host from the destination address.
        bind += ["--peer", f"{receives if ip_address(sends).is_unspecified else sends}:0"]
    key = {"--key-file": gateway.key_file, "--key-env": gateway.key_env}
    bind += [word for name, value in key.items() if value is not None for word in (name, value)]
    if importlib.util.find_spec("rclpy") and importlib.util.find_spec("udp_bridge_ros2"):
        return ["-m", "udp_bridge_ros2", *bind]
    if importlib.util.find_spec("udp_bridge") is None:
        raise RequirementError(
            "the Python package `udp_bridge` is not installed. Fix: pip install "
            "'groundlink[gateway]', or pass --no-ros"
        )
    shown.print(
        "ROS 2 is not installed here: using a plain UDP Bridge receiver instead of the ROS node"
    )
    return ["-m", "udp_bridge", "listen", *bind, "--report", "--quiet"]
