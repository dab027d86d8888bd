# SPDX-License-Identifier: Apache-2.0
"""`groundlink secure SCENARIO FOLDER`: what a run needs that strangers could reach.

Rule: it writes and starts nothing. What is written is secret but for the Compose file.
"""

from __future__ import annotations

import argparse
import datetime
import os
import secrets
from pathlib import Path

from groundlink.bus.credentials import ABOUT, AUTHORITY, CERTIFICATE, KEY, about_text
from groundlink.cli.run.running import SCENARIO_HELP
from groundlink.core.atomic_file import write_atomically
from groundlink.core.errors import UserError
from groundlink.core.extras import needs
from groundlink.deploy.access_control import OPERATOR, access_control, grants
from groundlink.deploy.compose import BRIDGE_KEY, MAIN, Deployment
from groundlink.loader import load
from groundlink.loader.scenario_files import scenario_file

USER = 65532
"""Whose files they become where root makes them: the user of the images."""

ROUTER_NAME = "router"


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "secure", help="make certificates, access rules and the bridge's key for a scenario"
    )
    parser.add_argument("scenario", help=SCENARIO_HELP)
    parser.add_argument("folder", type=Path, help="where to write them; not there yet")
    parser.add_argument(
        "--name",
        metavar="HOST",
        action="append",
        default=[],
        help="a name or address of the router's machine, by which others reach it; repeatable",
    )
    parser.add_argument(
        "--host", metavar="LABEL", default=MAIN, help="whose Compose file is written (%(default)s)"
    )
    parser.add_argument("--router", metavar="ENDPOINT", help="as of `groundlink compose`")
    parser.set_defaults(command=secure)


def secure(options: argparse.Namespace) -> int:
    """Write a folder for each process, the bridge's key, and what is laid over the Compose file."""
    with needs("secure"):
        from groundlink.deploy.certificates import Authority
    file = scenario_file(options.scenario)
    scenario, folder = load(file), options.folder
    if folder.exists():
        raise UserError(f"{folder}: it exists already; delete it or choose another name")
    authority = Authority(datetime.datetime.now(datetime.UTC))
    folder.parent.mkdir(parents=True, exist_ok=True)
    with write_atomically(folder) as part:
        part.mkdir(mode=0o700)
        for process in (ROUTER_NAME, *(name for name, _ in grants(scenario))):
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
        f"{folder}: one folder a process, of which each machine needs only its own; {OPERATOR} is "
        f"for your command line.\ndocker compose -f compose.yaml -f {over} up"
    )
    return 0


def _write(file: Path, content: bytes) -> None:
    """Write a file that nobody else reads."""
    with open(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as handle:
        handle.write(content)
    _give(file)


def _give(path: Path) -> None:
    if os.geteuid() == 0:
        os.chown(path, USER, USER)
