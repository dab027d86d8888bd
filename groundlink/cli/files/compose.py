# SPDX-License-Identifier: Apache-2.0
"""`groundlink compose SCENARIO`: print the Compose file of a scenario's containers."""

import argparse
import sys

from groundlink.cli import Subparsers
from groundlink.cli.run.running import SCENARIO_HELP, load_scenario
from groundlink.deploy.compose import MAIN, Deployment
from groundlink.loader.scenario_files import scenario_file


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("compose", help="print the Compose file of a scenario")
    parser.add_argument("scenario", help=SCENARIO_HELP)
    parser.add_argument(
        "--host",
        metavar="LABEL",
        default=MAIN,
        help="host whose processes to include, a `host` of sensors in the scenario (%(default)s)",
    )
    parser.add_argument(
        "--router",
        metavar="ENDPOINT",
        help="router as seen from that host, such as tcp/sim.example:7447; required with --host",
    )
    parser.add_argument(
        "--overload",
        choices=("slow", "skip", "fail"),
        help="what to do if a sensor is slow or cut off (default: as in the scenario)",
    )
    parser.add_argument(
        "--sources", metavar="FOLDER", default=".", help="build context of the images (%(default)s)"
    )
    parser.set_defaults(command=compose)


def compose(options: argparse.Namespace) -> int:
    """Print the Compose file."""
    file = scenario_file(options.scenario)
    deployment = Deployment(
        load_scenario(file),
        file.absolute(),
        sources=options.sources,
        router=options.router,
        overload=options.overload,
    )
    sys.stdout.write(deployment.compose(options.host))
    for label in deployment.hosts():
        if label != options.host:
            router = "" if label == MAIN else " --router ENDPOINT"
            print(
                f"more processes on host `{label}`: run again with --host {label}{router}",
                file=sys.stderr,
            )
    return 0
