# SPDX-License-Identifier: Apache-2.0
"""What every process of a run does alike: arguments, signals, joining a run, saying how it is.

Rule: a process ends with 0 when it is asked to end, with 2 and one line when the user can mend what
is wrong, with 3 and one line when this machine lacks what it needs, with 4 and one line when the
scenario has the run end. It never leaves its session open.
"""

from __future__ import annotations

import argparse
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Sequence
from typing import NoReturn

import msgspec

from groundlink.bus.queries import scenario_key
from groundlink.bus.session import DEFAULT_ENDPOINT, Bus
from groundlink.bus.topics import HEALTH, ROOT
from groundlink.core.errors import TOO_MANY_FILES, RequirementError, UserError, os_error_reason
from groundlink.messages.base import Health, StreamReport
from groundlink.scenario import Scenario

from . import asset_exchange
from .liveness_file import LivenessFile
from .name_claim import Claims, NoClaim

JOIN_SECONDS = 20.0
"""How long a process waits for physics to serve the run's scenario, or what it missed."""

HEALTH_PERIOD_SECONDS = 1.0


class NoSuchHost(UserError):
    """A host's name has no address, or none yet."""


def parser(process: str, description: str) -> argparse.ArgumentParser:
    """Return the argument parser that all processes share."""
    arguments = argparse.ArgumentParser(prog=process, description=description)
    arguments.add_argument(
        "--connect", metavar="ENDPOINT", help="router or physics to join, such as tcp/HOST:7447"
    )
    arguments.add_argument("--run", help="name of the run; needed only where several run")
    return arguments


ROUTER_VARIABLE = "GROUNDLINK_ROUTER"
"""Environment variable with the endpoint to join where `--connect` is not given."""


def router_of(options: argparse.Namespace) -> str | None:
    """Return the endpoint to join: as told, or of the environment; None where there is none."""
    return options.connect or os.environ.get(ROUTER_VARIABLE)


def endpoint(options: argparse.Namespace) -> str:
    """Return where to join: as told, or where physics listens by default."""
    return router_of(options) or DEFAULT_ENDPOINT


def address(text: str) -> tuple[str, int]:
    """Return `HOST:PORT` as a numeric address.

    Raises
    ------
    UserError
        when it is no address; `NoSuchHost` when the host has none.
    """
    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal() or int(port) > 65535:
        raise UserError(f"`{text}` is no address; expected HOST:PORT such as 127.0.0.1:7511")
    try:
        return socket.gethostbyname(host), int(port)
    except OSError:
        raise NoSuchHost(f"`{text}`: no host is called `{host}`") from None


def run(process: str, main: Callable[[Sequence[str], threading.Event], None]) -> NoReturn:
    """Run a process's `main(arguments, stop)` and exit; `stop` is set when it should end."""
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    try:
        main(sys.argv[1:], stop)
    except UserError as error:
        print(f"{process}: {error}", file=sys.stderr)
        sys.exit(error.exit_code)
    except OSError as error:
        if error.errno not in TOO_MANY_FILES:
            raise
        print(f"{process}: {os_error_reason(error)}", file=sys.stderr)
        sys.exit(RequirementError.exit_code)
    sys.exit(0)


def join(bus: Bus, run_name: str | None, stop: threading.Event) -> tuple[str, Scenario]:
    """Return the name and the resolved scenario of the run that is on the bus.

    Raises
    ------
    UserError
        when there is none within `JOIN_SECONDS`, or several and no name was given.
    """
    deadline = time.monotonic() + JOIN_SECONDS
    while not stop.is_set():
        replies = bus.ask(scenario_key(run_name or "*"), seconds=1.0)
        runs = {key.split("/")[1]: payload for key, payload in replies.items()}
        if len(runs) > 1:
            raise UserError(f"several runs are on the bus, name one with --run: {', '.join(runs)}")
        for name, payload in runs.items():
            return name, msgspec.msgpack.decode(payload, type=Scenario)
        if time.monotonic() > deadline:
            wanted = f"run `{run_name}`" if run_name else "run"
            raise UserError(
                f"no {wanted} was found on the bus within {JOIN_SECONDS:.0f} s; "
                f"is physics running there? (key {ROOT}/<run>/scenario)"
            )
        stop.wait(0.2)
    raise SystemExit(0)


def join_world(bus: Bus, run_name: str | None, stop: threading.Event) -> tuple[str, Scenario]:
    """Join a run, as `join` does, and fetch what of its world's assets this machine lacks.

    Raises
    ------
    UserError
        also when they are not to be had.
    """
    run_name, scenario = join(bus, run_name, stop)
    asset_exchange.fetch(bus, run_name, scenario)
    return run_name, scenario


def changed_world(bus: Bus, run_name: str, world: str) -> Scenario | None:
    """Return the scenario of a run's world by its hash, its assets at hand; None if there is none.

    Raises
    ------
    UserError
        when assets are not to be had.
    """
    replies = bus.ask(scenario_key(run_name), world, seconds=JOIN_SECONDS)
    for payload in replies.values():
        scenario = msgspec.msgpack.decode(payload, type=Scenario)
        asset_exchange.fetch(bus, run_name, scenario)
        return scenario
    return None


class Heartbeat:
    """Tells the run once a second how a process is."""

    def __init__(self, bus: Bus, run_name: str, process: str, claim: Claims | None = None) -> None:
        key = HEALTH.key_in(run_name, process=process)
        self._process, self._claim = process, claim or NoClaim()
        self._publish = bus.publisher(key, HEALTH.delivery)
        self._next = 0.0
        self._alive = LivenessFile(process, bus.is_linked, os.environ)
        bus.announce(key)

    def due(self) -> bool:
        """Return whether a second has passed since the last beat."""
        return time.monotonic() >= self._next

    def beat(
        self,
        tick: int,
        counters: dict[str, int],
        streams: Sequence[StreamReport] = (),
        *,
        is_well: bool = True,
    ) -> None:
        """Publish the process's health; touch the liveness file only if `is_well`.

        Raises
        ------
        UserError
            when another one has taken its place.
        """
        self._next = time.monotonic() + HEALTH_PERIOD_SECONDS
        health = Health(
            self._process, os.getpid(), tick, counters, tuple(streams), socket.gethostname()
        )
        self._publish(health)
        if is_well:
            self._alive.show(time.monotonic())
        self._claim.check(time.monotonic())
