# SPDX-License-Identifier: Apache-2.0
"""`groundlink compose SCENARIO`: print the Compose file of a scenario's containers."""

from __future__ import annotations

import argparse
import sys

from groundlink.cli.run.running import SCENARIO_HELP
from groundlink.deploy.compose import MAIN, Deployment
from groundlink.loader import load
from groundlink.loader.scenario_files import scenario_file


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("compose", help="print the Compose file of a scenario")
    parser.add_argument("scenario", help=SCENARIO_HELP)
    parser.add_argument(
        "--host",
        metavar="LABEL",
        default=MAIN,
        help="of the sensors with this `host` in the scenario (default: of all that has none)",
    )
    parser.add_argument(
        "--router",
        metavar="ENDPOINT",
        help="where other hosts find the router, such as tcp/sim.example:7447; needed with --host",
    )
    parser.add_argument(
        "--overload",
        choices=("slow", "skip", "fail"),
        help="what gives way when a sensor is slow or cut off (default: as the scenario says)",
    )
    parser.add_argument(
        "--sources", metavar="FOLDER", default=".", help="what images are built from (%(default)s)"
    )
    parser.set_defaults(command=compose)


def compose(options: argparse.Namespace) -> int:
    """Print it."""
    file = scenario_file(options.scenario)
    deployment = Deployment(
        load(file),
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
                f"there are processes for the host `{label}`: --host {label}{router}",
                file=sys.stderr,
            )
    return 0
