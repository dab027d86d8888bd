# SPDX-License-Identifier: Apache-2.0
"""Batches of states: nobody waits for a state that waits for its batch."""

import pytest

from groundlink.core.clock import TICK_NANOS
from groundlink.messages.base import BusMessage, State, StateBatch, decode, encode
from groundlink.scenario.schema import Time
from services.physics.run.publishers import StatePublisher


def state(tick: int, episode: int = 1) -> State:
    return State("run", episode, 0, tick, tick * TICK_NANOS, "hash", {})


class Published:
    """Batches that were published, as a receiver reads them."""

    def __init__(self) -> None:
        self.batches: list[list[int]] = []

    def __call__(self, message: BusMessage) -> bytes:
        payload = encode(message)
        self.batches.append([one.tick for one in decode(payload, StateBatch).states])
        return payload


@pytest.fixture
def published() -> Published:
    return Published()


def test_batches_have_four_states_and_end_at_acknowledgements(published: Published) -> None:
    publish = StatePublisher(encode, published, Time(window_ticks=80))
    payloads = [publish(state(tick)) for tick in range(13)]
    assert published.batches == [[0], [1, 2, 3, 4], [5, 6, 7, 8], [9, 10], [11, 12]]
    assert payloads == [encode(state(tick)) for tick in range(13)]


def test_batches_of_a_run_without_a_wall_clock_last_until_the_next_acknowledgement(
    published: Published,
) -> None:
    publish = StatePublisher(encode, published, Time(mode="fast", window_ticks=80))
    for tick in range(21):
        publish(state(tick))
    assert published.batches == [[0], [*range(1, 11)], [*range(11, 21)]]


def test_the_first_state_of_an_episode_ends_a_batch(published: Published) -> None:
    publish = StatePublisher(encode, published, Time())
    for one in (state(7), state(8), state(9), state(7, episode=2)):
        publish(one)
    assert published.batches == [[7], [8], [9, 7]]


def test_a_flush_publishes_what_waits_and_nothing_twice(published: Published) -> None:
    publish = StatePublisher(encode, published, Time())
    for tick in range(3):
        publish(state(tick))
    publish.flush()
    publish.flush()
    assert published.batches == [[0], [1, 2]]
