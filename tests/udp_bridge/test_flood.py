# SPDX-License-Identifier: Apache-2.0
"""Floods of first parts, from one sender or many: memory, cost, and who still gets through."""

import itertools
import sys
import tracemalloc
from collections.abc import Iterator

import pytest

from udp_bridge import Header, Limits, Reassembler
from udp_bridge.receiver.pool import KEPT_BYTES

FLOOD = 4000
MS = 1_000_000
IMU_EVERY = 10
LIMITS = Limits()


def first_part(number: int, size: int) -> bytes:
    """Return part 0 of 255 of a message of its own, on one of many topics."""
    return Header(1, number, 0, 255, 0, 0, f"/{number % 300}").pack() + bytes(size)


def imu(number: int) -> bytes:
    return Header(2, number, 0, 1, number, 0, "/imu", "imu").pack() + bytes(300)


def flood(reassembler: Reassembler, senders: int, size: int) -> Iterator[int]:
    """Let a flood of a second arrive, and an IMU in between; yield its messages handed over."""
    came = 0
    for index in range(FLOOD):
        now_nanos = index * 1000 * MS // FLOOD
        if not index % IMU_EVERY:
            number = index // IMU_EVERY
            came += reassembler.receive(imu(number), "imu", now_nanos) is not None
        reassembler.receive(first_part(index, size), index % senders, now_nanos)
        yield came


@pytest.mark.parametrize("size", [1, 300, 8000])
@pytest.mark.parametrize("senders", [1, 40, FLOOD])
def test_a_flood_of_first_parts_stays_within_the_memory(senders: int, size: int) -> None:
    reassembler = Reassembler()
    tracemalloc.start()
    came = 0
    for came in flood(reassembler, senders, size):  # noqa: B007
        assert reassembler.memory_bytes <= LIMITS.memory_per_sender
    _, peak_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert came == FLOOD // IMU_EVERY
    names_bytes = 20_000 * LIMITS.topics  # what is known of topics is bounded by their number
    assert peak_bytes <= LIMITS.memory_per_sender + KEPT_BYTES + names_bytes
    # What is counted is what is held: small messages take little indeed.
    if size == 1:
        assert peak_bytes < 4 << 20 if senders == 1 else names_bytes
    assert reassembler.counters.refused["busy"] > FLOOD // 4


@pytest.mark.parametrize("senders", [1, 40, FLOOD])
def test_the_cost_of_a_flood_does_not_grow(senders: int) -> None:
    reassembler = Reassembler()
    calls = 0

    def count(*_: object) -> None:
        nonlocal calls
        calls += 1

    costs = []
    events = flood(reassembler, senders, 300)
    while True:
        before = calls
        sys.setprofile(count)
        is_over = not list(itertools.islice(events, 500))
        sys.setprofile(None)
        if is_over:
            break
        costs.append(calls - before)
    assert max(costs[1:]) < 1.5 * costs[0]
    assert max(costs) < 500 * 400  # of calls and returns, C's included


def test_a_known_sender_keeps_its_open_messages_and_topics_in_a_flood_of_strangers() -> None:
    reassembler = Reassembler()
    large = Header(1, 0, 0, 3, 0, 0, "/points")
    reassembler.receive(imu(0), "known", 0)
    reassembler.receive(large.pack() + bytes(60_000), "known", 0)
    for index in range(FLOOD):
        reassembler.receive(first_part(index, 60_000), ("stranger", index), index)
        single = Header(7, index, 0, 2, 0, 0, f"/{index}").pack() + b"x"
        reassembler.receive(single, "topics of a stranger", index)
    for number in (1, 2):
        part = large._replace(part_number=number).pack() + bytes(60_000)
        message = reassembler.receive(part, "known", FLOOD)
    assert message is not None
    assert reassembler.receive(imu(0), "known", FLOOD) is None  # known for a copy


def test_completed_messages_use_no_memory() -> None:
    reassembler = Reassembler()
    for index in range(5 * LIMITS.incomplete_per_s):
        for number in (0, 1):
            header = Header(1, index, number, 2, 0, 0, "/points")
            message = reassembler.receive(header.pack() + b"12345678", "a", index)
        assert message is not None


def test_after_a_while_a_sender_may_begin_messages_again() -> None:
    reassembler = Reassembler()
    for index in range(FLOOD):
        reassembler.receive(first_part(index, 8), "a", 0)
    assert reassembler.counters.refused == {"busy": FLOOD - LIMITS.incomplete_per_s}
    refused = sum(reassembler.counters.refused.values())
    reassembler.receive(first_part(FLOOD, 8), "a", 1000 * MS // LIMITS.incomplete_per_s)
    reassembler.receive(first_part(FLOOD + 1, 8), "a", 1000 * MS // LIMITS.incomplete_per_s)
    assert sum(reassembler.counters.refused.values()) == refused + 1
