# SPDX-License-Identifier: Apache-2.0
"""How a process makes sure that it is the only one of its name in a run, and stays it.

Rule: of those that start at the same instant one goes on, and every other one says who it is and
ends. Each claims the name by a token of its own before it looks who else does: of two that look,
the later one sees both. The lowest claim wins; who lost takes its claim back and waits for the
winner to show itself. Of two that run, as one was cut off when the other was started, the one with
the highest claim goes on: claims begin with the time, so where the hosts' clocks agree that is the
later one, which the others have joined. Nothing is kept anywhere: tokens end with their sessions.
"""

from __future__ import annotations

import random
import time
from typing import Protocol

from groundlink.bus.core_topics import HEALTH, ROOT
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.core.errors import UserError
from groundlink.messages.base import Health

GONE_SECONDS = 15.0
"""After this long Zenoh has told that a process is gone that was cut off: its lease is 10 s."""

YIELD_SECONDS = 3.0
"""Who has seen a lower claim than its own has long taken its own back; so who keeps one runs."""

LOOK_SECONDS = 1.0
PAUSE_SECONDS = 0.1


def claims_key(run: str, process: str) -> str:
    """Return the key of the tokens by which processes claim a name, a number each below it."""
    return f"{ROOT}/{run}/claims/{process}"


class Claims(Protocol):
    """A process's claim to its name, while it runs."""

    def check(self, now_seconds: float) -> None:
        """Look whether the name is still this process's alone; to be called every second or so.

        Raises
        ------
        UserError
            once, when another one has taken its place.
        """


def claim_name(bus: Bus, run_name: str, process: str) -> Claims:
    """Return when no other process of this name is in a run, nor will be.

    One that was cut off is still counted as there for some seconds; it is waited for.

    Raises
    ------
    UserError
        when there is one, and it is well.
    """
    there = _There(bus, run_name, process)
    claims = claims_key(run_name, process)
    own = f"{claims}/{time.time_ns():019}{random.getrandbits(31):010}"
    while True:
        while there.is_there() or _others(bus, claims, own):
            time.sleep(PAUSE_SECONDS)
        withdraw = bus.announce(own)
        if _is_mine(bus, claims, own):
            return NameClaim(bus, run_name, process, own)
        withdraw()


def _others(bus: Bus, claims: str, own: str) -> set[str]:
    return bus.present(f"{claims}/*", seconds=LOOK_SECONDS) - {own}


def _is_mine(bus: Bus, claims: str, own: str) -> bool:
    """Return whether the name is this process's, which has claimed it."""
    deadline = time.monotonic() + YIELD_SECONDS
    while others := _others(bus, claims, own):
        # A higher claim that stays has looked before this one was there, and has won.
        if min(others) < own or time.monotonic() > deadline:
            return False
        time.sleep(PAUSE_SECONDS)
    return True


class NameClaim:
    """Sees who else claims the name of a process that runs.

    Parameters
    ----------
    own
        key of this process's claim.
    """

    def __init__(self, bus: Bus, run_name: str, process: str, own: str) -> None:
        self._bus, self._run, self._process, self._own = bus, run_name, process, own
        self._higher: dict[str, float] = {}
        """By claim above the own one: since when it is there."""

        bus.watch(f"{claims_key(run_name, process)}/*", self._on_change)

    def _on_change(self, key: str, there: bool) -> None:
        if not there:
            self._higher.pop(key, None)
        elif key > self._own:
            self._higher.setdefault(key, time.monotonic())

    def check(self, now_seconds: float) -> None:
        """See `Claims`."""
        for key, since in self._higher.copy().items():
            if now_seconds - since <= YIELD_SECONDS:
                continue
            # Where nobody answers in time it is looked again: it goes when its token goes.
            if self._bus.present(key, seconds=LOOK_SECONDS):
                self._higher.clear()
                raise UserError(
                    f"another `{self._process}` of run `{self._run}` was started while this one "
                    "was cut off, and goes on; this one ends"
                )


class NoClaim:
    """Stands for the claim of a process of which several may be there."""

    def check(self, now_seconds: float) -> None:
        """Do nothing."""


class _There:
    """Looks for a process of the name that is there, and does not wait for ever."""

    def __init__(self, bus: Bus, run_name: str, process: str) -> None:
        self._bus, self._run, self._process = bus, run_name, process
        self._key = HEALTH.key_in(run_name, process=process)
        self._beats: BusInbox[Health] | None = None
        self._deadline = time.monotonic() + GONE_SECONDS

    def is_there(self) -> bool:
        """Return whether one is there that may be gone.

        Raises
        ------
        UserError
            when it is well, or it or another one that starts does not go in time.
        """
        is_there = bool(self._bus.present(self._key, seconds=LOOK_SECONDS))
        where = "and does not answer" if is_there else "or is just being started"
        if is_there and self._beats is None:
            self._beats = BusInbox(depth=1)
            self._bus.subscribe(self._key, Health, self._beats)
        beat = self._beats.get(seconds=0.5) if is_there and self._beats is not None else None
        if beat is not None:
            where = f"on {beat[1].host} (process {beat[1].pid})"
        if beat is not None or time.monotonic() > self._deadline:
            raise UserError(
                f"`{self._process}` of run `{self._run}` is there already, {where}; end it, or "
                "give --run another name"
            )
        return is_there
