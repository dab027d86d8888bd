# SPDX-License-Identifier: Apache-2.0
"""Join a run: fetch its scenario and its assets, and publish the process's health."""

from __future__ import annotations

import os
import socket
import threading
import time
from collections.abc import Sequence

import msgspec

from groundlink.bus.core_topics import HEALTH, ROOT
from groundlink.bus.queries import scenario_key
from groundlink.bus.session import Bus
from groundlink.core.errors import UserError
from groundlink.messages.base import Health, StreamReport
from groundlink.scenario import Scenario

from . import asset_exchange
from .liveness_file import LivenessFile
from .name_claim import Claims, NoClaim

JOIN_SECONDS = 20.0
"""Timeout for the run's scenario, and for states that a process has missed."""

HEALTH_PERIOD_SECONDS = 1.0


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
