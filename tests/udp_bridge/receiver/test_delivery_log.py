# SPDX-License-Identifier: Apache-2.0
import pytest
from hypothesis import given
from hypothesis import strategies as st

from udp_bridge import Message
from udp_bridge.receiver.delivery_log import (
    AGES_KEPT,
    AGES_NANOS,
    REMEMBERED,
    WAITING_KEPT,
    DeliveryLog,
    MessageOutcomes,
    percentile,
)
from udp_bridge.receiver.ordering import key_of
from udp_bridge.wire.control import NO_AGE, TopicReport

WALL = 10**18
STARTS = st.sampled_from([0, 5, 2**31 - 10, 2**32 - 10])


@pytest.fixture
def outcomes() -> MessageOutcomes:
    return MessageOutcomes()


def missing(outcomes: MessageOutcomes) -> int:
    known = outcomes.delivered + outcomes.incomplete + outcomes.late + outcomes.open_count
    return outcomes.numbers - known


def counts(outcomes: MessageOutcomes) -> tuple[int, ...]:
    return (
        outcomes.numbers,
        outcomes.delivered,
        outcomes.incomplete,
        outcomes.late,
        missing(outcomes),
    )


@pytest.mark.parametrize("start", [0, 2**32 - 2])
def test_gaps_are_missing_until_they_get_an_outcome(start: int, outcomes: MessageOutcomes) -> None:
    outcomes.settle(start, "delivered")
    outcomes.mark_arrived((start + 4) % 2**32)
    assert (*counts(outcomes), outcomes.open_count) == (5, 1, 0, 0, 3, 1)
    assert outcomes.first_number == start
    outcomes.settle((start + 2) % 2**32, "late")
    outcomes.settle((start + 4) % 2**32, "incomplete")
    assert (*counts(outcomes), outcomes.open_count) == (5, 1, 1, 1, 2, 0)


def test_a_second_outcome_does_not_count(outcomes: MessageOutcomes) -> None:
    assert outcomes.settle(3, "delivered")
    assert not outcomes.settle(3, "late")
    assert counts(outcomes) == (1, 1, 0, 0, 0)


def test_what_was_overtaken_at_the_very_begin_counts(outcomes: MessageOutcomes) -> None:
    outcomes.settle(5, "delivered")
    outcomes.settle(3, "late")
    assert (outcomes.first_number, *counts(outcomes)) == (3, 3, 1, 0, 1, 1)


def test_what_is_too_old_keeps_its_outcome(outcomes: MessageOutcomes) -> None:
    outcomes.settle(0, "delivered")
    outcomes.settle(REMEMBERED + 1, "delivered")
    assert not outcomes.settle(0, "late")
    assert not outcomes.settle(1, "late")
    assert outcomes.settle(2, "late")
    assert counts(outcomes) == (REMEMBERED + 2, 2, 0, 1, REMEMBERED - 1)


def test_a_forged_jump_takes_no_memory(outcomes: MessageOutcomes) -> None:
    outcomes.settle(0, "delivered")
    outcomes.mark_arrived(2**31 - 1)
    assert outcomes._arrived.bit_length() <= REMEMBERED
    assert counts(outcomes)[0] == 2**31


def test_repaired_counts_delivered_messages_only(outcomes: MessageOutcomes) -> None:
    outcomes.settle(0, "delivered")
    for number, outcome in ((1, "delivered"), (2, "incomplete"), (3, "late")):
        outcomes.mark_repaired(number)
        outcomes.settle(number, outcome)
    assert outcomes.repaired == 1


@given(
    STARTS,
    st.lists(
        st.tuples(
            st.integers(0, 60), st.sampled_from(["arrived", "delivered", "incomplete", "late"])
        )
    ),
)
def test_every_number_has_one_outcome(start: int, steps: list[tuple[int, str]]) -> None:
    outcomes = MessageOutcomes()
    model: dict[int, str] = {}
    first = None
    for offset, what in steps:
        number = (start + offset) % 2**32
        first = offset if first is None else first
        if what == "arrived":
            outcomes.mark_arrived(number)
        else:
            outcomes.settle(number, what)
        first = min(first, offset)
        if model.get(offset, "arrived") == "arrived":
            model[offset] = what
    settled = list(model.values())
    numbers = max(model) - first + 1 if first is not None else 0
    assert (*counts(outcomes), outcomes.open_count) == (
        numbers,
        *(settled.count(outcome) for outcome in ("delivered", "incomplete", "late")),
        numbers - len(model),
        settled.count("arrived"),
    )


def imu(seq_number: int, stamp_nanos: int, body: bytes = b"x") -> Message:
    return Message(2, "/imu", "imu", stamp_nanos, seq_number, body)


@pytest.fixture
def log() -> DeliveryLog:
    return DeliveryLog()


def deliver(log: DeliveryLog, message: Message) -> Message:
    log.mark_arrived(message.header())
    log.mark_delivered(key_of(message), len(message.body))
    return message


def publish(log: DeliveryLog, message: Message, wall_nanos: int = WALL) -> None:
    log.mark_published(key_of(deliver(log, message)), wall_nanos)


def test_counts_bytes_stamps_and_ages(log: DeliveryLog) -> None:
    for number, age in enumerate([500, 10, 100]):
        publish(log, imu(7 + number, WALL - age))
    assert log.report(2, 4, WALL) == TopicReport(
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
    assert log.report(2, 4, WALL + 9).since_nanos == WALL


def test_an_age_is_taken_at_publication_and_reported_for_10_s(log: DeliveryLog) -> None:
    message = deliver(log, imu(0, WALL))
    waiting = log.report(2, 0, WALL + 50)
    assert (waiting.published, waiting.pending, waiting.age_p50_nanos) == (0, 1, NO_AGE)
    log.mark_published(key_of(message), WALL + 90)
    assert log.report(2, 0, WALL + AGES_NANOS + 90).age_p50_nanos == 90
    silent = log.report(2, 0, WALL + AGES_NANOS + 91)
    assert (silent.published, silent.age_p50_nanos, silent.age_p99_nanos) == (1, NO_AGE, NO_AGE)


def test_clocks_of_two_machines_may_disagree(log: DeliveryLog) -> None:
    publish(log, imu(0, WALL + 10))
    assert log.report(2, 0, WALL).age_p50_nanos == -10


def test_each_message_counts_once_however_often_it_is_marked(log: DeliveryLog) -> None:
    message = deliver(log, imu(0, 1))
    log.mark_dropped(key_of(message))
    log.mark_dropped(key_of(message))
    log.mark_published(key_of(message), WALL)
    log.mark_published((9, 9), WALL)  # never delivered, or before a restart
    report = log.report(2, 0, WALL)
    assert (report.dropped, report.published, report.pending, report.missing) == (1, 0, 0, 0)


def test_memory_is_bounded(log: DeliveryLog) -> None:
    for number in range(WAITING_KEPT + 3):
        deliver(log, imu(number, number))
    report = log.report(2, 0, WALL)
    assert (report.dropped, report.pending) == (3, WAITING_KEPT)
    for number in range(WAITING_KEPT + 3, WAITING_KEPT + 5 + AGES_KEPT):
        publish(log, imu(number, WALL - number), WALL)
    report = log.report(2, 0, WALL)
    assert report.age_p50_nanos == WAITING_KEPT + 4 + AGES_KEPT // 2
    assert report.missing == 0


@pytest.mark.parametrize(
    ("count", "p50", "p99"), [(1, 0, 0), (2, 0, 1), (100, 49, 98), (101, 50, 99), (1000, 499, 989)]
)
def test_percentiles(count: int, p50: int, p99: int) -> None:
    ordered = list(range(count))
    assert (percentile(ordered, 50), percentile(ordered, 99)) == (p50, p99)
    assert sum(age <= p99 for age in ordered) >= 0.99 * count
