# SPDX-License-Identifier: Apache-2.0
"""Who is waited for has every state, whatever the bus loses; the bus is stood in for."""

import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, cast

import pytest

from groundlink.bus.channel import WAKE_SECONDS, BusChannel
from groundlink.bus.core_topics import STATE_BATCH
from groundlink.bus.session import Bus
from groundlink.core.clock import TICK_NANOS
from groundlink.messages.base import Ack, State, StateBatch, encode
from groundlink.process.state_follower import StateFollower, follow_states

EPISODE = 5
BATCH = 3
ACK_TICKS = 4


def state(tick: int, episode: int = EPISODE) -> State:
    return State("run", episode, 0, tick, tick * TICK_NANOS, "hash", {})


@dataclass
class Taker:
    """Writes down what it gets, and acknowledges as a sensor does."""

    taken: list[int] = field(default_factory=list)
    resumed: int = 0
    tick: int = -1
    acknowledged_tick: int = -1

    def resume(self, ack: Ack) -> None:
        self.resumed += 1
        self.tick = self.acknowledged_tick = ack.tick

    def take(self, state: State, waiting: int = 0) -> None:
        if state.tick > self.tick or not state.tick:
            self.tick = state.tick
            self.taken.append(state.tick)
            if not state.tick % ACK_TICKS:
                self.acknowledged_tick = state.tick


@dataclass
class Source:
    """Payloads that have all come."""

    payloads: deque[bytes]

    def receive(self) -> bytes:
        if not self.payloads:
            time.sleep(WAKE_SECONDS)
        return self.poll() or b""

    def poll(self) -> bytes | None:
        return self.payloads.popleft() if self.payloads else None

    def undeclare(self) -> None: ...


class Physics:
    """Serves what it has told, and knows what it was told."""

    def __init__(self, ticks: int, acknowledged: int, arriving: Iterable[int] = ()) -> None:
        self.told, self.acknowledged = [state(tick) for tick in range(ticks)], acknowledged
        self.arriving = [state(tick) for tick in arriving]
        self.asked = 0

    def query(self, key: str, name: str, *, seconds: float) -> dict[str, bytes]:
        self.asked += 1
        if self.asked == 1:
            return {}  # at the start there was nothing yet
        ack = Ack(EPISODE, self.acknowledged, self.acknowledged)
        kept = [ack, *(one for one in self.told if one.tick > self.acknowledged)]
        return {str(number): encode(message) for number, message in enumerate(kept)}

    def channel(
        self, key: str, message: Any, *, depth: int, local: bool = False
    ) -> BusChannel[Any]:
        arriving: Sequence[State | StateBatch] = self.arriving
        if key == STATE_BATCH.key_in("run"):
            starts = range(0, len(self.arriving), BATCH)
            arriving = [StateBatch(tuple(self.arriving[i : i + BATCH])) for i in starts]
        payloads = deque(map(encode, arriving))
        return BusChannel(Source(payloads), message, depth=depth)

    def publisher(self, key: str, delivery: object) -> Callable[[object], None]:
        return lambda message: None

    def announce(self, key: str) -> None: ...

    def hold(self) -> None: ...

    def flush(self) -> None: ...

    def reconnects(self) -> int:
        return 0

    def present(self, key: str, *, seconds: float) -> set[str]:
        return {key}

    def is_connected(self) -> bool:
        return True


@pytest.fixture(autouse=True)
def _short_timeouts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("groundlink.core.backoff.FIRST_SECONDS", 0.05)


@pytest.fixture(params=[True, False], ids=["each state", "batches"])
def is_urgent(request: pytest.FixtureRequest) -> bool:
    return bool(request.param)


def follow(
    physics: Physics,
    taker: Taker,
    ended: Callable[[], bool],
    *,
    waited_for: bool,
    is_urgent: bool = True,
) -> None:
    followers = [
        StateFollower("rover/imu", taker, lambda: {"refused": 0}, is_urgent=is_urgent),
    ]
    follow_states(cast(Bus, physics), "run", followers, ended, waited_for=waited_for)


def until(condition: Callable[[], bool], most: int = 30) -> Callable[[], bool]:
    left = iter(range(most))
    return lambda: condition() or next(left, None) is None


@pytest.mark.parametrize("waited_for", [True, False])
def test_states_that_got_lost_in_between(waited_for: bool, is_urgent: bool) -> None:
    physics, taker = Physics(8, 0, (0, 1, 5, 6, 7)), Taker()
    follow(
        physics, taker, until(lambda: taker.tick == 7), waited_for=waited_for, is_urgent=is_urgent
    )
    if waited_for:
        assert taker.taken == [0, 1, *range(1, 8)], "from the last acknowledgement on, and all"
    else:
        assert taker.taken == [0, 1, 5, 6, 7]


def test_the_last_states_got_lost_and_no_other_will_come(is_urgent: bool) -> None:
    physics, taker = Physics(8, 0, (0, 1)), Taker()
    follow(physics, taker, until(lambda: taker.tick == 7), waited_for=True, is_urgent=is_urgent)
    assert taker.taken[-7:] == [*range(1, 8)]


def test_an_acknowledgement_got_lost(is_urgent: bool) -> None:
    physics, taker = Physics(6, 0, range(6)), Taker()
    follow(physics, taker, until(lambda: taker.resumed > 0), waited_for=True, is_urgent=is_urgent)
    assert taker.resumed == 1
    assert taker.acknowledged_tick == 4


def test_the_first_state_of_an_episode_got_lost(is_urgent: bool) -> None:
    physics, taker = Physics(1, -1), Taker()
    taker.tick = taker.acknowledged_tick = 300  # of another one
    follow(
        physics, taker, until(lambda: taker.taken[-1:] == [0]), waited_for=True, is_urgent=is_urgent
    )
    assert taker.taken[-1] == 0


def test_a_follower_with_all_states_of_a_paused_run_is_not_restarted(is_urgent: bool) -> None:
    physics, taker = Physics(6, 4, range(6)), Taker()
    follow(physics, taker, until(lambda: physics.asked > 2), waited_for=True, is_urgent=is_urgent)
    assert physics.asked > 2
    assert taker.resumed == 0
    assert taker.taken == [*range(6)]


def test_states_of_batches_come_in_order_with_the_number_of_those_that_wait() -> None:
    physics, waiting = Physics(0, -1, range(8)), []
    taker = Taker()
    taker.take = lambda state, left=0: waiting.append((state.tick, left))  # type: ignore[method-assign, assignment]
    follow(physics, taker, until(lambda: len(waiting) == 8), waited_for=False, is_urgent=False)
    # Batches have three states; of the last one it is not known that it has two.
    assert waiting == [(0, 8), (1, 7), (2, 6), (3, 5), (4, 4), (5, 3), (6, 1), (7, 0)]
