# SPDX-License-Identifier: Apache-2.0
"""Name claim: at most one process of a name runs in a run.

Of processes that start at the same time, one continues; the others end with an error. Each process
declares a claim (a liveliness token) before it reads the claims of others, so of two starting
processes the later one sees both. The lowest claim wins. A losing process withdraws its claim and
waits for the winner's health message.

Two processes of one name can run if one was cut off when the other started. Then the highest claim
continues. NameClaim start with the time, so with synchronized clocks that is the newer process,
which the rest of the run has joined. NameClaim end with their sessions; nothing is stored.
"""

import random
import time

from groundlink.bus.core_topics import HEALTH, ROOT
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.core.errors import UserError
from groundlink.messages.base import Health

GONE_SECONDS = 15.0
"""Time after which Zenoh has removed a process that was cut off: its lease is 10 s."""

YIELD_SECONDS = 3.0
"""Grace period. A losing process has withdrawn its claim by now, so a remaining claim belongs to a
running process."""

LOOK_SECONDS = 1.0
PAUSE_SECONDS = 0.1


def claims_key(run: str, process: str) -> str:
    """Return the key of the claims to a process name; each claim appends a number."""
    return f"{ROOT}/{run}/claims/{process}"


def claim_name(bus: Bus, run_name: str, process: str) -> "NameClaim":
    """Return the claim once no other process of this name is in the run.

    Waits for a process that was cut off, which stays visible until its lease ends.

    Raises
    ------
    UserError
        if a process of this name is running.
    """
    existing = _Existing(bus, run_name, process)
    claims = claims_key(run_name, process)
    own = f"{claims}/{time.time_ns():019}{random.getrandbits(31):010}"
    while True:
        while existing.is_present() or _others(bus, claims, own):
            time.sleep(PAUSE_SECONDS)
        withdraw = bus.announce(own)
        if _is_mine(bus, claims, own):
            return NameClaim(bus, run_name, process, own)
        withdraw()


def _others(bus: Bus, claims: str, own: str) -> set[str]:
    return bus.present(f"{claims}/*", seconds=LOOK_SECONDS) - {own}


def _is_mine(bus: Bus, claims: str, own: str) -> bool:
    """Return whether the claim `own` has won."""
    deadline = time.monotonic() + YIELD_SECONDS
    while others := _others(bus, claims, own):
        # A higher claim that stays was checked before this one existed, and has won.
        if min(others) < own or time.monotonic() > deadline:
            return False
        time.sleep(PAUSE_SECONDS)
    return True


class NameClaim:
    """The claim of a running process, with key `own`; detects newer claims to the name."""

    def __init__(self, bus: Bus, run_name: str, process: str, own: str) -> None:
        self._bus, self._run, self._process, self._own = bus, run_name, process, own
        self._higher: dict[str, float] = {}
        """Time of appearance of each claim above the own one."""

        bus.watch(f"{claims_key(run_name, process)}/*", self._on_change)

    def _on_change(self, key: str, present: bool) -> None:
        if not present:
            self._higher.pop(key, None)
        elif key > self._own:
            self._higher.setdefault(key, time.monotonic())

    def check(self, now_seconds: float) -> None:
        """Check for a newer process of this name; call about once a second.

        Raises
        ------
        UserError
            once, if a newer process continues in place of this one.
        """
        for key, since in self._higher.copy().items():
            if now_seconds - since <= YIELD_SECONDS:
                continue
            # After a timeout the next call checks again, until the token is gone.
            if self._bus.present(key, seconds=LOOK_SECONDS):
                self._higher.clear()
                raise UserError(
                    f"run `{self._run}`: another `{self._process}` was started while this process "
                    "was cut off; ending in favor of the newer one"
                )


class NoClaim:
    """Stands in for the claim of a process that may run several times."""

    def check(self, now_seconds: float) -> None:
        """Do nothing."""


class _Existing:
    """Checks for an existing process of the name, with a deadline."""

    def __init__(self, bus: Bus, run_name: str, process: str) -> None:
        self._bus, self._run, self._process = bus, run_name, process
        self._key = HEALTH.key_in(run_name, process=process)
        self._beats: BusInbox[Health] | None = None
        self._deadline = time.monotonic() + GONE_SECONDS

    def is_present(self) -> bool:
        """Return whether a process of the name is present and may be gone soon.

        Raises
        ------
        UserError
            if it is running, or is still present after the deadline.
        """
        is_present = bool(self._bus.present(self._key, seconds=LOOK_SECONDS))
        where = "does not respond" if is_present else "is being started"
        if is_present and self._beats is None:
            self._beats = BusInbox(depth=1)
            self._bus.subscribe(self._key, Health, self._beats)
        beat = self._beats.get(seconds=0.5) if is_present and self._beats is not None else None
        if beat is not None:
            where = f"runs on {beat[1].host} (pid {beat[1].pid})"
        if beat is not None or time.monotonic() > self._deadline:
            raise UserError(
                f"run `{self._run}`: another `{self._process}` {where}. Fix: end it, or choose "
                "another name with --run"
            )
        return is_present
