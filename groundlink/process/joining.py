# SPDX-License-Identifier: Apache-2.0
"""Join a run: fetch its scenario and its assets, and publish the process's health."""

import os
import socket
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from groundlink.bus.core_topics import HEALTH, ROOT, ROUTER_KEY
from groundlink.bus.queries import scenario_key
from groundlink.bus.session import Bus
from groundlink.core.errors import DeafSession, UserError
from groundlink.messages.base import Health, StreamReport
from groundlink.scenario import Scenario
from groundlink.scenario.decoding import decode_scenario, missing_kinds

from . import asset_exchange
from .name_claim import NameClaim, NoClaim

JOIN_SECONDS = 20.0
"""Timeout for the run's scenario, and for states that a process has missed."""

HEALTH_PERIOD_SECONDS = 1.0


def join(bus: Bus, run_name: str | None, stop: threading.Event) -> tuple[str, Scenario]:
    """Return the name and the resolved scenario of the run on the bus.

    Raises
    ------
    UserError
        if no run is found within `JOIN_SECONDS`, or several are found and no name is given.
    """
    deadline = time.monotonic() + JOIN_SECONDS
    while not stop.is_set():
        replies = bus.query(scenario_key(run_name or "*"), seconds=1.0)
        runs = {key.split("/")[1]: payload for key, payload in replies.items()}
        if len(runs) > 1:
            raise UserError(
                f"several runs on the bus: {', '.join(runs)}. Fix: choose one with --run"
            )
        for name, payload in runs.items():
            return name, decode_scenario(payload)
        if time.monotonic() > deadline:
            wanted = f"run `{run_name}`" if run_name else "run"
            raise UserError(
                f"no {wanted} on the bus within {JOIN_SECONDS:.0f} s (key {ROOT}/<run>/scenario). "
                "Fix: check that physics is running and connected to this router"
            )
        stop.wait(0.2)
    raise SystemExit(0)


def report_missing_kinds(process: str, scenario: Scenario) -> None:
    """Print a line for each sensor kind of a run that is not installed here.

    For processes that carry readings; others do not need the kinds of other processes.
    """
    for line in missing_kinds(scenario):
        print(f"{process}: {line}", file=sys.stderr, flush=True)


def join_world(bus: Bus, run_name: str | None, stop: threading.Event) -> tuple[str, Scenario]:
    """Join a run like `join` and fetch the assets of its world that this machine lacks.

    Raises
    ------
    UserError
        also if an asset cannot be fetched.
    """
    run_name, scenario = join(bus, run_name, stop)
    asset_exchange.fetch(bus, run_name, scenario)
    return run_name, scenario


def changed_world(bus: Bus, run_name: str, world: str) -> Scenario | None:
    """Return the scenario with the world of a given hash, its assets fetched; None if unknown.

    Raises
    ------
    UserError
        if an asset cannot be fetched.
    """
    replies = bus.query(scenario_key(run_name), world, seconds=JOIN_SECONDS)
    for payload in replies.values():
        scenario = decode_scenario(payload)
        asset_exchange.fetch(bus, run_name, scenario)
        return scenario
    return None


class Heartbeat:
    """Publishes the health of a process once a second."""

    def __init__(
        self, bus: Bus, run_name: str, process: str, claim: NameClaim | NoClaim | None = None
    ) -> None:
        key = HEALTH.key_in(run_name, process=process)
        self._process, self._claim = process, claim or NoClaim()
        self._bus, self._check = bus, RouterCheck()
        self._publish = bus.publisher(key, HEALTH.delivery)
        self._next = 0.0
        self._liveness = LivenessFile(process, bus.is_connected, os.environ)
        bus.announce(key)

    def due(self) -> bool:
        """Return whether the next health message is due."""
        return time.monotonic() >= self._next

    def beat(
        self,
        tick: int,
        counters: dict[str, int],
        streams: Sequence[StreamReport] = (),
        *,
        is_well: bool = True,
    ) -> None:
        """Publish the health of the process; touch the liveness file only if `is_well`.

        Raises
        ------
        UserError
            if another process took over the name, or the router sends nothing (`DeafSession`).
        """
        self._next = time.monotonic() + HEALTH_PERIOD_SECONDS
        health = Health(
            self._process, os.getpid(), tick, counters, tuple(streams), socket.gethostname()
        )
        self._publish(health)
        if is_well:
            self._liveness.update(time.monotonic())
        self._claim.check(time.monotonic())
        is_due = self._check.is_due(self._bus.reconnects(), time.monotonic())
        if is_due and self._bus.is_connected():
            answers = self._bus.present(ROUTER_KEY, seconds=ANSWER_SECONDS)
            self._check.take(time.monotonic(), is_answered=bool(answers))


ANSWER_SECONDS = 0.7
"""Timeout for the router's answer, which takes a millisecond."""

WATCHED_SECONDS = 15.0
"""Time after a reconnection in which the router is asked; it ends old links within 10 s."""

DEAF_SECONDS = 12.0
"""Silence that makes a session deaf. One that is cut off, or whose router stands still, loses its
link after 10 s."""


class RouterCheck:
    """Decides when a connected session asks its router for an answer, and what silence means.

    Only routers that have answered before are expected to answer: a `zenohd` never does.
    """

    def __init__(self) -> None:
        self._reconnects = -1
        self._since = 0.0
        self._is_known = False
        self._silent_since: float | None = None

    def is_due(self, reconnects: int, now_seconds: float) -> bool:
        """Return whether to ask: at the start until it answers, and after each reconnection.

        Parameters
        ----------
        reconnects
            How often the session has reconnected so far.
        now_seconds
            Time of a monotonic clock.
        """
        if reconnects != self._reconnects:
            self._reconnects, self._since, self._silent_since = reconnects, now_seconds, None
        is_watched = now_seconds - self._since < WATCHED_SECONDS
        return self._silent_since is not None or (
            is_watched and (reconnects > 0 or not self._is_known)
        )

    def take(self, now_seconds: float, *, is_answered: bool) -> None:
        """Record whether the router answered in time.

        Raises
        ------
        DeafSession
            when a router that has answered before is silent for `DEAF_SECONDS`.
        """
        self._is_known |= is_answered
        if is_answered or not self._is_known:
            self._silent_since = None
        elif self._silent_since is None:
            self._silent_since = now_seconds
        elif now_seconds - self._silent_since > DEAF_SECONDS:
            raise DeafSession("connected, but the router sends nothing; starting again")


VARIABLE = "ALIVE_FILE"
"""Environment variable with the file name; without it no file is touched."""


class LivenessFile:
    """Touches the file, and logs when the connection to the router is lost and restored."""

    def __init__(
        self, process: str, is_connected: Callable[[], bool], environment: Mapping[str, str]
    ) -> None:
        name = environment.get(VARIABLE)
        self._process, self._is_connected = process, is_connected
        self._file = Path(name) if name else None
        self._disconnected_since: float | None = None

    def update(self, now_seconds: float) -> None:
        """Touch the file if connected; the time is of a monotonic clock."""
        if self._is_connected():
            if self._disconnected_since is not None:
                seconds = now_seconds - self._disconnected_since
                self._log(f"reconnected to the router after {seconds:.1f} s")
                self._disconnected_since = None
            if self._file is not None:
                self._file.touch()
        elif self._disconnected_since is None:
            self._disconnected_since = now_seconds
            self._log("connection to the router lost; reconnecting")

    def _log(self, text: str) -> None:
        print(f"{self._process}: {text}", file=sys.stderr, flush=True)
