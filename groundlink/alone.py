# SPDX-License-Identifier: Apache-2.0
"""How a process makes sure that it is the only one of its name in a run.

Rule: of those that start at the same instant one goes on, and every other one says who it is and
ends. Each claims the name by a token of its own before it looks who else does: of two that look,
the later one sees both. The lowest claim wins; who lost takes its claim back and waits for the
winner to show itself. Nothing is kept anywhere: tokens end with their sessions.
"""

from __future__ import annotations

import random
import time

from .bus import Bus
from .errors import UserError
from .inbox import Inbox
from .messages import Health
from .topics import HEALTH, ROOT

GONE_SECONDS = 15.0
"""After this long Zenoh has told that a process is gone that was cut off: its lease is 10 s."""

YIELD_SECONDS = 3.0
"""Who has seen a lower claim than its own has long taken its own back."""

LOOK_SECONDS = 1.0
PAUSE_SECONDS = 0.1


def claims_key(run: str, process: str) -> str:
    """Return the key of the tokens by which processes claim a name, a number each below it."""
    return f"{ROOT}/{run}/claims/{process}"


def alone(bus: Bus, run_name: str, process: str) -> None:
    """Return when no other process of this name is in a run, nor will be.

    One that was cut off is still counted as there for some seconds; it is waited for.

    Raises
    ------
    UserError
        when there is one, and it is well.
    """
    there = _There(bus, run_name, process)
    claims = claims_key(run_name, process)
    own = f"{claims}/{random.getrandbits(63):019}"
    while True:
        while there.is_there() or _others(bus, claims, own):
            time.sleep(PAUSE_SECONDS)
        withdraw = bus.announce(own)
        if _is_mine(bus, claims, own):
            return
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


class _There:
    """Looks for a process of the name that is there, and does not wait for ever."""

    def __init__(self, bus: Bus, run_name: str, process: str) -> None:
        self._bus, self._run, self._process = bus, run_name, process
        self._key = HEALTH.key_in(run_name, process=process)
        self._beats: Inbox[Health] | None = None
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
            self._beats = Inbox(depth=1)
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
