# SPDX-License-Identifier: Apache-2.0
import pytest

from udp_bridge import Message
from udp_bridge.sender.delivery_counts import (
    MAX_TOPICS,
    SETTLED_NANOS,
    DeliveryCounter,
    DeliveryCounts,
)
from udp_bridge.wire.control import TopicReport

WALL = 10**18
SECOND = 10**9


@pytest.fixture
def counter() -> DeliveryCounter:
    return DeliveryCounter()


def send(counter: DeliveryCounter, count: int, stamp_nanos: int = 100) -> None:
    for number in range(count):
        counter.next_number((2, "/imu"), stamp_nanos + number, len(b"body"))


def report(
    numbers: int, *, first: int = 0, since: int = WALL, seen_at: int = 100, **changes: int
) -> TopicReport:
    counts = dict.fromkeys(TopicReport._fields, 0) | {
        "msg_type": 2,
        "first_number": first % 2**32,
        "since_nanos": since,
        "numbers": numbers,
        "first_seen_stamp_nanos": seen_at,
    }
    return TopicReport(**(counts | changes))


def row(counter: DeliveryCounter, now_nanos: int = 0) -> DeliveryCounts:
    (found,) = counter.counts(now_nanos)
    parts = found.delivered + found.dropped + found.incomplete + found.late
    assert found.sent == parts + found.missing + found.in_flight
    return found


def test_what_was_sent_is_in_flight_until_it_is_reported(counter: DeliveryCounter) -> None:
    send(counter, 10)
    counter.superseded(Message(2, "/imu", "imu", 1, 0, b""))
    found = row(counter)
    assert (found.sent, found.sent_bytes, found.in_flight) == (10, 40, 10)
    assert found.superseded == 1
    counter.reported(
        "/imu",
        report(8, published=3, dropped=1, incomplete=1, late=1, pending=1, repaired=2),
        WALL,
    )
    found = row(counter)
    assert found[5:12] == (3, 1, 1, 1, 1, 1 + 2, 2)


def test_unreported_messages_are_missing_after_a_while(counter: DeliveryCounter) -> None:
    send(counter, 10)
    counter.reported("/other", report(1), WALL)
    assert row(counter).missing == 0
    send(counter, 5)
    assert row(counter, SETTLED_NANOS).missing == 10
    assert row(counter, SETTLED_NANOS).in_flight == 5
    counter.reported("/imu", report(12, published=11, pending=1), WALL)  # it took long
    found = row(counter, SETTLED_NANOS)
    assert (found.missing, found.delivered, found.in_flight) == (0, 11, 1 + 3)


def test_nothing_is_missing_at_a_receiver_without_reports(counter: DeliveryCounter) -> None:
    send(counter, 10)
    row(counter)
    assert row(counter, SETTLED_NANOS).in_flight == 10


def test_counts_of_a_restarted_receiver_are_added(counter: DeliveryCounter) -> None:
    send(counter, 30)
    counter.reported("/imu", report(10, published=8, pending=1, body_bytes=32), WALL)
    again = WALL + 5 * SECOND
    counter.reported(
        "/imu", report(15, first=15, since=again, seen_at=115, published=14, body_bytes=56), again
    )
    found = row(counter)
    # 10..14 were sent to nobody, one was open when the receiver ended, and two were not seen.
    assert (found.delivered, found.missing, found.delivered_bytes) == (22, 1 + 1 + 5 + 1, 88)


def test_a_message_with_two_outcomes_counts_once(counter: DeliveryCounter) -> None:
    send(counter, 10)
    counter.reported("/imu", report(10, published=9, incomplete=1), WALL)
    again = report(1, first=9, since=WALL + SECOND, seen_at=109, published=1)
    counter.reported("/imu", again, WALL + SECOND)
    found = row(counter)
    assert (found.delivered, found.incomplete, found.missing) == (10, 0, 0)


def test_reports_about_a_sender_that_was_here_before_are_ignored(counter: DeliveryCounter) -> None:
    send(counter, 10, stamp_nanos=1000)
    for old in (report(5, published=5, seen_at=999), report(11, published=11, seen_at=1000)):
        counter.reported("/imu", old, WALL)
    assert row(counter).delivered == 0
    counter.reported("/imu", report(10, published=10, seen_at=1000), WALL)
    assert row(counter).delivered == 10


def test_a_report_that_was_overtaken_is_ignored(counter: DeliveryCounter) -> None:
    send(counter, 10)
    counter.reported("/imu", report(10, published=10), WALL)
    counter.reported("/imu", report(5, published=5), WALL - SECOND)
    assert row(counter).delivered == 10
    counter.reported("/imu", report(10, published=9), WALL - 60 * SECOND)  # the clock was set
    assert row(counter).delivered == 9


def test_reports_about_unknown_topics_take_no_memory(counter: DeliveryCounter) -> None:
    counter.reported("/imu", report(5), WALL)
    assert counter.counts(0) == []


@pytest.mark.parametrize(("signed_peer", "modulus"), [(False, 2**32), (True, 2**31)])
def test_a_message_has_the_number_of_those_before_it(signed_peer: bool, modulus: int) -> None:
    counter = DeliveryCounter(signed_peer=signed_peer)
    keys = [(1, "/a"), (1, "/a"), (1, "/b"), (2, "/a"), (1, "/a")]
    assert [counter.next_number(key, 0, 1) for key in keys] == [0, 1, 0, 0, 2]
    counter._topics[1, "/a"].sent = modulus - 1
    assert [counter.next_number((1, "/a"), 0, 1) for _ in range(2)] == [modulus - 1, 0]


def test_forgotten_topics_start_over(counter: DeliveryCounter) -> None:
    counter.next_number((1, "/first"), 0, 1)
    for index in range(MAX_TOPICS):
        counter.next_number((1, str(index)), 0, 1)
    assert counter.next_number((1, "/first"), 0, 1) == 0
    assert counter.next_number((1, str(MAX_TOPICS - 1)), 0, 1) == 1
