# SPDX-License-Identifier: Apache-2.0
"""`groundlink secure SCENARIO FOLDER`: write certificates and keys for a run on a shared network.

All files are secret except the Compose file.
"""

import argparse
import datetime
import os
import secrets
from pathlib import Path

from groundlink.bus.credentials import ABOUT, AUTHORITY, CERTIFICATE, KEY, about_text
from groundlink.cli import Subparsers
from groundlink.cli.run.running import SCENARIO_HELP, load_scenario
from groundlink.cli.terminal.progress import tracked
from groundlink.core.atomic_file import write_atomically
from groundlink.core.errors import UserError
from groundlink.core.extras import needs
from groundlink.deploy.access_control import OPERATOR, access_control, grants
from groundlink.deploy.compose import BRIDGE_KEY, MAIN, Deployment
from groundlink.loader.scenario_files import scenario_file

USER = 65532
"""Owner of files that root writes: the user of the images."""

ROUTER_NAME = "router"


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "secure", help="write certificates, access rules and the bridge key of a scenario"
    )
    parser.add_argument("scenario", help=SCENARIO_HELP)
    parser.add_argument("folder", type=Path, help="new folder to write")
    parser.add_argument(
        "--name",
        metavar="HOST",
        action="append",
        default=[],
        help="host name or address of the router for other machines; repeatable",
    )
    parser.add_argument(
        "--host", metavar="LABEL", default=MAIN, help="host of the Compose file (%(default)s)"
    )
    parser.add_argument("--router", metavar="ENDPOINT", help="as for `groundlink compose`")
    parser.set_defaults(command=secure)


def secure(options: argparse.Namespace) -> int:
    """Write a folder for each process, the bridge key and a Compose override file."""
    with needs("secure"):
        from groundlink.deploy.certificates import Authority
    file = scenario_file(options.scenario)
    scenario, folder = load_scenario(file), options.folder
    if folder.exists():
        raise UserError(f"{folder}: folder exists. Fix: delete it or choose another name")
    authority = Authority(datetime.datetime.now(datetime.UTC))
    folder.parent.mkdir(parents=True, exist_ok=True)
    with write_atomically(folder) as part:
        part.mkdir(mode=0o700)
        processes = [ROUTER_NAME, *(name for name, _ in grants(scenario))]
        for process in tracked(processes, f"writing {folder}", len(processes)):
            own = part / process.replace("/", "-")
            own.mkdir(mode=0o700)
            is_router = process == ROUTER_NAME
            hosts = ("router", "localhost", "127.0.0.1", *options.name) if is_router else ()
            pem = authority.certify(process, hosts)
            rules = access_control(scenario) if is_router else None
            _write(own / AUTHORITY, authority.certificate)
            _write(own / CERTIFICATE, pem.certificate)
            _write(own / KEY, pem.key)
            _write(own / ABOUT, about_text(process, rules).encode())
            _give(own)
        _write(part / BRIDGE_KEY, secrets.token_hex(32).encode() + b"\n")
        deployment = Deployment(scenario, file.absolute(), sources=".", router=options.router)
        over = folder / "compose.yaml"
        (part / over.name).write_text(
            deployment.secured(str(folder.absolute()), options.host), encoding="utf-8"
        )
    print(
        f"wrote {folder}: one folder for each process. Copy to each machine only the folders of "
        f"its processes; `{OPERATOR}` is for the command line. Start with:\ndocker compose -f "
        f"compose.yaml -f {over} up"
    )
    return 0


def _write(file: Path, content: bytes) -> None:
    """Write a file that only its owner can read."""
    with open(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as handle:
        handle.write(content)
    _give(file)


def _give(path: Path) -> None:
    if os.geteuid() == 0:
        os.chown(path, USER, USER)
