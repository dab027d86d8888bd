# SPDX-License-Identifier: Apache-2.0
"""`groundlink worker --connect ENDPOINT`: evaluate points of a search on another host.

A worker keeps no state: when it ends, other workers evaluate the points that it has not reported.
"""

import argparse
import hashlib
import os
import platform
import tempfile
import uuid
from multiprocessing.connection import wait
from pathlib import Path
from typing import Any

import msgspec

from groundlink.bus.queries import points_key
from groundlink.bus.session import Bus
from groundlink.bus.zenoh_config import DEFAULT_ENDPOINT
from groundlink.cli import Subparsers
from groundlink.cli.run.running import load_scenario
from groundlink.cli.terminal import output as terminal
from groundlink.core import VERSION
from groundlink.core.errors import UserError
from groundlink.process.runner import endpoint
from groundlink.search.point_journal import PointOutcome
from groundlink.search.point_leases import WorkerOrders, WorkerReport

from .evaluation import EvaluationRequest
from .point_processes import PointProcess
from .result_folder import add_jobs_option, check_extra, content_of

REPORT_SECONDS = 0.5
"""Interval of reports; an ended point is reported at once."""

ANSWER_SECONDS = 3.0
"""Timeout of the search."""


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "worker",
        help="evaluate points of a search or a campaign that runs on another host",
        description="Evaluate points of `groundlink search --listen` or `groundlink campaign "
        "--listen` until Ctrl-C. The scenario and the check need the same paths on this host.",
    )
    parser.add_argument(
        "--connect",
        metavar="ENDPOINT",
        help=f"endpoint of the search (default: GROUNDLINK_ROUTER, or {DEFAULT_ENDPOINT})",
    )
    add_jobs_option(parser)
    parser.set_defaults(command=worker)


def worker(options: argparse.Namespace) -> int:
    """Evaluate points until Ctrl-C."""
    check_extra()
    if options.jobs < 1:
        raise UserError(f"--jobs {options.jobs}: expected 1 or more")
    with (
        tempfile.TemporaryDirectory(prefix="groundlink-worker-") as folder,
        Bus(connect=endpoint(options)) as bus,
    ):
        terminal.say(terminal.console(), f"evaluating points of {endpoint(options)}")
        points = _WorkerPoints(bus, options.jobs, Path(folder))
        try:
            while True:
                points.turn()
        finally:
            points.kill()


class _WorkerPoints:
    """Points that a worker evaluates, and outcomes that it has not reported yet."""

    def __init__(self, bus: Bus, jobs: int, folder: Path) -> None:
        self._bus, self._jobs, self._folder = bus, jobs, folder
        # Hosts in containers may have the same name and numbers of processes.
        self._name = f"{platform.node()}:{os.getpid()}:{uuid.uuid4().hex[:4]}"
        self._search = ""
        self._running: dict[PointProcess, str] = {}
        self._outcomes: dict[str, PointOutcome] = {}

    def turn(self) -> None:
        """Report, begin what the search wants, and wait for an end or the next report."""
        free = self._jobs - len(self._running)
        running = list(self._running.values())
        report = WorkerReport(self._name, self._search, running, self._outcomes, free)
        replies = self._bus.query(
            points_key(), seconds=ANSWER_SECONDS, content=msgspec.json.encode(report)
        )
        for reply in replies.values():
            self._obey(msgspec.json.decode(reply, type=WorkerOrders))
        ready = wait([process.output for process in self._running], REPORT_SECONDS)
        for process in [each for each in self._running if each.output in ready]:
            self._outcomes[self._running.pop(process)] = process.outcome()
            process.recording.unlink(missing_ok=True)

    def kill(self) -> None:
        """End all evaluations."""
        for process in self._running:
            process.kill()
        self._running.clear()

    def _obey(self, orders: WorkerOrders) -> None:
        """Begin points; those of another search are dropped."""
        self._outcomes = {}
        if orders.search != self._search:
            self.kill()
            check_host(orders.determined_by)
            self._search = orders.search
        for name, content in orders.start.items():
            request = msgspec.json.decode(content, type=EvaluationRequest)
            own = hashlib.sha256(name.encode()).hexdigest()[:16]
            recording = str(self._folder / f"{own}.mcap")
            self._running[PointProcess(msgspec.structs.replace(request, recording=recording))] = (
                name
            )


def check_host(determined_by: dict[str, Any]) -> None:
    """Check that this host has the scenario of a search.

    Raises
    ------
    UserError
        when it has another scenario or version.
    """
    scenario = determined_by["scenario"]
    own = {"groundlink": VERSION, "content of the scenario": content_of(load_scenario(scenario))}
    for name, value in own.items():
        if determined_by[name] != value:
            raise UserError(
                f"{scenario}: {name} is {value} here, and {determined_by[name]} at the search. "
                "Fix: use the same files and version on all hosts"
            )
