# SPDX-License-Identifier: Apache-2.0
"""State follower: deliver the states of a run to a process, first the missed ones, then all.

The bus loses states while a process is cut off, as after a suspension longer than the lease of 10
s. Physics keeps them, so a process that physics waits for can fetch them.
"""

import time
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

from groundlink.bus.channel import BusChannel
from groundlink.bus.core_topics import BATCH_TICKS, STATE, STATE_BATCH
from groundlink.bus.queries import history_key
from groundlink.bus.session import Bus
from groundlink.core.backoff import Backoff
from groundlink.messages.base import Ack, State, StateBatch, decode

from .joining import JOIN_SECONDS, Heartbeat
from .name_claim import NameClaim, NoClaim

STATES_KEPT = 4096
"""Queue for a busy process: ten seconds of sim time."""


class StateConsumer(Protocol):
    """Consumer of the states of a run."""

    @property
    def tick(self) -> int:
        """Tick of the last state taken; -1 before the first."""

    @property
    def acknowledged_tick(self) -> int:
        """Tick of the last acknowledgement sent; negative before the first."""

    def resume(self, ack: Ack) -> None:
        """Continue from the acknowledgement of a predecessor."""

    def take(self, state: State, waiting: int = 0) -> None:
        """Process one state, in order; `waiting` more are in the queue."""


class StateFollower(NamedTuple):
    """One consumer of a process that follows the states of a run."""

    name: str
    """Process name in the run."""

    consumer: StateConsumer
    counters: Callable[[], dict[str, int]]
    """Returns the health counters, with `refused` among them."""

    claim: NameClaim | NoClaim = NoClaim()

    is_urgent: bool = True
    """Whether it needs each state at once. States of others come in batches."""


def follow_states(
    bus: Bus,
    run_name: str,
    followers: Sequence[StateFollower],
    ended: Callable[[], bool],
    *,
    waited_for: bool = False,
) -> None:
    """Deliver the states of a run to followers until `ended`: first the missed ones, then all.

    Followers have missed states when they start, and when a new episode of physics does not begin
    with its first state because physics restored a saved run.

    Parameters
    ----------
    waited_for
        physics waits for these followers and keeps the states that the bus lost, even the newest.
    """
    # Where physics waits, nothing may overtake what it has published before a state.
    local = not waited_for
    states: BusChannel[State] | BusChannel[StateBatch]
    if any(follower.is_urgent for follower in followers):
        states = bus.channel(STATE.key_in(run_name), State, depth=STATES_KEPT, local=local)
    else:
        batches, depth = STATE_BATCH.key_in(run_name), STATES_KEPT // BATCH_TICKS
        states = bus.channel(batches, StateBatch, depth=depth, local=local)
    episode = _catch_up(bus, run_name, followers)
    heartbeats = [Heartbeat(bus, run_name, f.name, f.claim) for f in followers]
    backoff = Backoff(time.monotonic())
    if waited_for:
        bus.hold()
    while not ended():
        if arrived := states.get():
            backoff.reset(time.monotonic())
            batch = arrived.states if isinstance(arrived, StateBatch) else (arrived,)
            for count, state in enumerate(batch, 1):
                if state.episode != episode:
                    missed_of = _catch_up(bus, run_name, followers) if state.tick else None
                    episode = missed_of or state.episode
                elif waited_for and any(0 <= f.consumer.tick < state.tick - 1 for f in followers):
                    _catch_up(bus, run_name, followers)
                waiting = len(batch) * (1 + len(states)) - count
                for follower in followers:
                    follower.consumer.take(state, waiting)
        elif waited_for and backoff.is_due(time.monotonic()):
            episode = _catch_up(bus, run_name, followers, episode) or episode
        for heartbeat, follower in zip(heartbeats, followers, strict=True):
            if heartbeat.due():
                counts = follower.counters()
                counts["refused"] += states.refused
                heartbeat.beat(follower.consumer.tick, counts)
        bus.flush()


def _catch_up(
    bus: Bus, run_name: str, followers: Sequence[StateFollower], known_episode: int | None = None
) -> int | None:
    """Deliver missed states to followers; return their episode, None if there were none.

    In the known episode, skip a follower that has taken and acknowledged all states.
    """
    episode = None
    for name, consumer, *_ in followers:
        missed = list(bus.query(history_key(run_name), name, seconds=JOIN_SECONDS).values())
        if missed:
            ack = decode(missed[0], Ack)
            episode = ack.episode
            if episode == known_episode and _has_all(consumer, ack, missed[1:]):
                continue
            consumer.resume(ack)
            for payload in missed[1:]:
                consumer.take(decode(payload, State))
    return episode


def _has_all(consumer: StateConsumer, ack: Ack, states: Sequence[bytes]) -> bool:
    """Return whether the consumer has taken the last state and physics has its acknowledgement."""
    is_taken = not states or decode(states[-1], State).tick <= consumer.tick
    return is_taken and consumer.acknowledged_tick <= ack.tick
