# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

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


def send(accounts: DeliveryCounter, count: int, stamp_nanos: int = 100) -> None:
    for number in range(count):
        accounts.next_number((2, "/imu"), stamp_nanos + number, len(b"body"))


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


def row(accounts: DeliveryCounter, now_nanos: int = 0) -> DeliveryCounts:
    (account,) = accounts.counts(now_nanos)
    parts = account.delivered + account.dropped + account.incomplete + account.late
    assert account.sent == parts + account.missing + account.in_flight
    return account


def test_what_was_sent_is_in_flight_until_it_is_reported() -> None:
    accounts = DeliveryCounter()
    send(accounts, 10)
    accounts.superseded(Message(2, "/imu", "imu", 1, 0, b""))
    account = row(accounts)
    assert (account.sent, account.sent_bytes, account.in_flight) == (10, 40, 10)
    assert account.superseded == 1
    accounts.reported(
        "/imu",
        report(8, published=3, dropped=1, incomplete=1, late=1, pending=1, repaired=2),
        WALL,
    )
    account = row(accounts)
    assert account[5:12] == (3, 1, 1, 1, 1, 1 + 2, 2)


def test_unreported_messages_are_missing_after_a_while() -> None:
    accounts = DeliveryCounter()
    send(accounts, 10)
    assert row(accounts).missing == 0
    send(accounts, 5)
    assert row(accounts, SETTLED_NANOS).missing == 10
    assert row(accounts, SETTLED_NANOS).in_flight == 5
    accounts.reported("/imu", report(12, published=11, pending=1), WALL)  # it took long
    account = row(accounts, SETTLED_NANOS)
    assert (account.missing, account.delivered, account.in_flight) == (0, 11, 1 + 3)


def test_counts_of_a_restarted_receiver_are_added() -> None:
    accounts = DeliveryCounter()
    send(accounts, 30)
    accounts.reported("/imu", report(10, published=8, pending=1, body_bytes=32), WALL)
    again = WALL + 5 * SECOND
    accounts.reported(
        "/imu", report(15, first=15, since=again, seen_at=115, published=14, body_bytes=56), again
    )
    account = row(accounts)
    # 10..14 were sent to nobody, one was open when the receiver ended, and two were not seen.
    assert (account.delivered, account.missing, account.delivered_bytes) == (22, 1 + 1 + 5 + 1, 88)


def test_a_message_with_two_outcomes_counts_once() -> None:
    accounts = DeliveryCounter()
    send(accounts, 10)
    accounts.reported("/imu", report(10, published=9, incomplete=1), WALL)
    again = report(1, first=9, since=WALL + SECOND, seen_at=109, published=1)
    accounts.reported("/imu", again, WALL + SECOND)
    account = row(accounts)
    assert (account.delivered, account.incomplete, account.missing) == (10, 0, 0)


def test_reports_about_a_sender_that_was_here_before_are_ignored() -> None:
    accounts = DeliveryCounter()
    send(accounts, 10, stamp_nanos=1000)
    for old in (report(5, published=5, seen_at=999), report(11, published=11, seen_at=1000)):
        accounts.reported("/imu", old, WALL)
    assert row(accounts).delivered == 0
    accounts.reported("/imu", report(10, published=10, seen_at=1000), WALL)
    assert row(accounts).delivered == 10


def test_a_report_that_was_overtaken_is_ignored() -> None:
    accounts = DeliveryCounter()
    send(accounts, 10)
    accounts.reported("/imu", report(10, published=10), WALL)
    accounts.reported("/imu", report(5, published=5), WALL - SECOND)
    assert row(accounts).delivered == 10
    accounts.reported("/imu", report(10, published=9), WALL - 60 * SECOND)  # the clock was set
    assert row(accounts).delivered == 9


def test_reports_about_unknown_topics_take_no_memory() -> None:
    accounts = DeliveryCounter()
    accounts.reported("/imu", report(5), WALL)
    assert accounts.counts(0) == []


@pytest.mark.parametrize(("signed_peer", "modulus"), [(False, 2**32), (True, 2**31)])
def test_a_message_has_the_number_of_those_before_it(signed_peer: bool, modulus: int) -> None:
    accounts = DeliveryCounter(signed_peer=signed_peer)
    keys = [(1, "/a"), (1, "/a"), (1, "/b"), (2, "/a"), (1, "/a")]
    assert [accounts.next_number(key, 0, 1) for key in keys] == [0, 1, 0, 0, 2]
    accounts._topics[1, "/a"].sent = modulus - 1
    assert [accounts.next_number((1, "/a"), 0, 1) for _ in range(2)] == [modulus - 1, 0]


def test_topics_that_are_forgotten_begin_anew() -> None:
    accounts = DeliveryCounter()
    accounts.next_number((1, "/first"), 0, 1)
    for index in range(MAX_TOPICS):
        accounts.next_number((1, str(index)), 0, 1)
    assert accounts.next_number((1, "/first"), 0, 1) == 0
    assert accounts.next_number((1, str(MAX_TOPICS - 1)), 0, 1) == 1
