# SPDX-License-Identifier: Apache-2.0
"""How a process follows a run's states: those that it missed, then all as they come.

Rule: who is waited for misses none. The bus loses what comes while a process is cut off, as one is
that was stopped for longer than a link lives (10 s); physics has it still.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

from groundlink.bus.core_topics import STATE
from groundlink.bus.inbox import BusInbox
from groundlink.bus.queries import history_key
from groundlink.bus.session import Bus
from groundlink.core.backoff import Backoff
from groundlink.messages.base import Ack, State, decode

from .joining import JOIN_SECONDS, Heartbeat
from .name_claim import Claims, NoClaim

STATES_KEPT = 4096
"""States that may wait for a busy process: ten seconds of sim time."""


class StateConsumer(Protocol):
    """What a process that follows a run's states does with them."""

    @property
    def tick(self) -> int:
        """The last one taken; -1 for none yet."""

    @property
    def acknowledged_tick(self) -> int:
        """The last one that it has told to have taken; less than 0 for none yet."""

    def resume(self, ack: Ack) -> None:
        """Go on where a predecessor stopped."""

    def take(self, state: State, waiting: int = 0) -> None:
        """Take one state, in order; so many more have arrived by now."""


class StateFollower(NamedTuple):
    """A process that follows a run's states, or one of several parts of it that do."""

    name: str
    """As others know it."""

    taker: StateConsumer
    counters: Callable[[], dict[str, int]]
    """What it counts, `refused` among it, to which messages are added that were none."""

    claim: Claims = NoClaim()
    """To its name."""


def follow_states(
    bus: Bus,
    run_name: str,
    followers: Sequence[StateFollower],
    ended: Callable[[], bool],
    *,
    waited_for: bool = False,
) -> None:
    """Give a run's states to followers until it has ended: those that they missed, then all.

    They have missed some at their own start, and where a life of physics is heard of that has come
    further than its first state: physics was restored to where a run once was.

    Parameters
    ----------
    waited_for
        Physics never goes on without them: what the bus has lost, as it does for a process that was
        stopped for longer than a link lives, physics has still, and its newest state may be it.
    """
    states: BusInbox[State] = BusInbox(depth=STATES_KEPT)
    bus.subscribe(STATE.key_in(run_name), State, states)
    life = _catch_up(bus, run_name, followers)
    heartbeats = [Heartbeat(bus, run_name, f.name, f.claim) for f in followers]
    quiet = Backoff(time.monotonic())
    while not ended():
        if arrived := states.get(seconds=0.1):
            quiet.heard(time.monotonic())
            state = arrived[1]
            if state.life != life:
                missed_of = _catch_up(bus, run_name, followers) if state.tick else None
                life = missed_of or state.life
            elif waited_for and any(0 <= f.taker.tick < state.tick - 1 for f in followers):
                _catch_up(bus, run_name, followers)
            for follower in followers:
                follower.taker.take(state, len(states))
        elif waited_for and quiet.is_too_long(time.monotonic()):
            life = _catch_up(bus, run_name, followers, life) or life
        for heartbeat, follower in zip(heartbeats, followers, strict=True):
            if heartbeat.due():
                counts = follower.counters()
                counts["refused"] += states.refused
                heartbeat.beat(follower.taker.tick, counts)


def _catch_up(
    bus: Bus, run_name: str, followers: Sequence[StateFollower], known_life: int | None = None
) -> int | None:
    """Give followers what they missed; return of which life it is, None where that was nothing.

    Of the life that is known, who has all states and is known to have them has missed nothing.
    """
    life = None
    for name, taker, *_ in followers:
        missed = list(bus.ask(history_key(run_name), name, seconds=JOIN_SECONDS).values())
        if missed:
            ack = decode(missed[0], Ack)
            life = ack.life
            if life == known_life and _has_all(taker, ack, missed[1:]):
                continue
            taker.resume(ack)
            for payload in missed[1:]:
                taker.take(decode(payload, State))
    return life


def _has_all(taker: StateConsumer, ack: Ack, states: Sequence[bytes]) -> bool:
    """Return whether somebody has taken the last of these states, and physics knows how far."""
    is_taken = not states or decode(states[-1], State).tick <= taker.tick
    return is_taken and taker.acknowledged_tick <= ack.tick
