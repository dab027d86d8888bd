# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import pytest

from udp_bridge import Message
from udp_bridge.receiver.arrivals import (
    AGES_KEPT,
    AGES_NANOS,
    WAITING_KEPT,
    TopicArrivals,
    key_of,
    percentile,
)
from udp_bridge.wire.control import NO_AGE, TopicReport

WALL = 10**18


def imu(seq_number: int, stamp_nanos: int, body: bytes = b"x") -> Message:
    return Message(2, "/imu", "imu", stamp_nanos, seq_number, body)


def come(arrivals: TopicArrivals, message: Message) -> Message:
    arrivals.seen(message.header())
    arrivals.handed(key_of(message), len(message.body))
    return message


def publish(arrivals: TopicArrivals, message: Message, wall_nanos: int = WALL) -> None:
    arrivals.published(key_of(come(arrivals, message)), wall_nanos)


def test_counts_bytes_stamps_and_ages() -> None:
    arrivals = TopicArrivals()
    for number, age in enumerate([500, 10, 100]):
        publish(arrivals, imu(7 + number, WALL - age))
    assert arrivals.report(2, 4, WALL) == TopicReport(
        msg_type=2,
        first_number=7,
        since_nanos=WALL,
        numbers=3,
        published=3,
        dropped=0,
        incomplete=0,
        late=0,
        pending=0,
        repaired=0,
        duplicates=4,
        body_bytes=3,
        first_seen_stamp_nanos=WALL - 500,
        first_stamp_nanos=WALL - 500,
        last_stamp_nanos=WALL - 100,
        age_p50_nanos=100,
        age_p99_nanos=500,
    )
    assert arrivals.report(2, 4, WALL + 9).since_nanos == WALL


def test_an_age_is_taken_at_publication_and_told_for_10_s() -> None:
    arrivals = TopicArrivals()
    message = come(arrivals, imu(0, WALL))
    waiting = arrivals.report(2, 0, WALL + 50)
    assert (waiting.published, waiting.pending, waiting.age_p50_nanos) == (0, 1, NO_AGE)
    arrivals.published(key_of(message), WALL + 90)
    assert arrivals.report(2, 0, WALL + AGES_NANOS + 90).age_p50_nanos == 90
    silent = arrivals.report(2, 0, WALL + AGES_NANOS + 91)
    assert (silent.published, silent.age_p50_nanos, silent.age_p99_nanos) == (1, NO_AGE, NO_AGE)


def test_clocks_of_two_machines_may_disagree() -> None:
    arrivals = TopicArrivals()
    publish(arrivals, imu(0, WALL + 10))
    assert arrivals.report(2, 0, WALL).age_p50_nanos == -10


def test_each_message_counts_once_whatever_its_user_says() -> None:
    arrivals = TopicArrivals()
    message = come(arrivals, imu(0, 1))
    arrivals.drop(key_of(message))
    arrivals.drop(key_of(message))
    arrivals.published(key_of(message), WALL)
    arrivals.published((9, 9), WALL)  # never handed over, or in another life
    report = arrivals.report(2, 0, WALL)
    assert (report.dropped, report.published, report.pending, report.missing) == (1, 0, 0, 0)


def test_memory_is_bounded() -> None:
    arrivals = TopicArrivals()
    for number in range(WAITING_KEPT + 3):
        come(arrivals, imu(number, number))
    report = arrivals.report(2, 0, WALL)
    assert (report.dropped, report.pending) == (3, WAITING_KEPT)
    for number in range(WAITING_KEPT + 3, WAITING_KEPT + 5 + AGES_KEPT):
        publish(arrivals, imu(number, WALL - number), WALL)
    report = arrivals.report(2, 0, WALL)
    assert report.age_p50_nanos == WAITING_KEPT + 4 + AGES_KEPT // 2
    assert report.missing == 0


@pytest.mark.parametrize(
    ("count", "p50", "p99"), [(1, 0, 0), (2, 0, 1), (100, 49, 98), (101, 50, 99), (1000, 499, 989)]
)
def test_percentiles(count: int, p50: int, p99: int) -> None:
    ordered = list(range(count))
    assert (percentile(ordered, 50), percentile(ordered, 99)) == (p50, p99)
    assert sum(age <= p99 for age in ordered) >= 0.99 * count
