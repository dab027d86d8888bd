# SPDX-License-Identifier: Apache-2.0
"""Times are milliseconds here, for readability."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from udp_bridge.flow import CreditWindow, DatagramKey, Pacer, TokenBucket, kernel_bytes

MS = 1_000_000
SIZE = 65_300
COST = 66_324


def key(number: int) -> DatagramKey:
    return DatagramKey(1, "/points", number // 255, number % 255)


@pytest.mark.parametrize(
    ("size", "measured"),
    [
        (20, 832),
        (500, 1280),
        (1472, 2305),
        (4000, 8456),
        (8192, 16644),
        (9000, 16644),
        (16384, 17225),
        (32768, 33689),
        (65300, 66576),
        (65507, 66576),
    ],
)
def test_the_estimate_is_not_far_from_what_the_kernel_was_measured_to_take(
    size: int, measured: int
) -> None:
    assert kernel_bytes(size) >= measured * 0.99
    assert kernel_bytes(size) < 2 * measured


def test_one_datagram_may_always_go_when_none_is_in_flight() -> None:
    window = CreditWindow()
    window.acknowledged(key(0), 1000, 0)
    assert window.window_bytes == 500
    assert window.may_send(SIZE, 0)
    window.sent(key(1), SIZE, 0)
    assert not window.may_send(20, 0)


def test_a_credit_frees_its_datagram_and_all_before_it() -> None:
    window = CreditWindow()
    window.acknowledged(key(0), 8 * COST, 0)
    for number in range(1, 5):
        assert window.may_send(SIZE, 0)
        window.sent(key(number), SIZE, 0)
    assert window.in_flight_bytes == 4 * COST
    assert not window.may_send(SIZE, 0)
    window.acknowledged(key(3), 8 * COST, 0)
    assert window.in_flight_bytes == COST
    window.acknowledged(key(2), 8 * COST, 0)  # of one that is no longer in flight
    assert window.in_flight_bytes == COST


@given(st.lists(st.tuples(st.integers(256, 65507), st.booleans()), max_size=200))
def test_the_window_is_never_exceeded(steps: list[tuple[int, bool]]) -> None:
    window = CreditWindow()
    window.acknowledged(key(0), 400_000, 0)
    oldest = 0
    for number, (size, is_acknowledged) in enumerate(steps):
        if window.may_send(size, 0):
            window.sent(key(number), size, 0)
        assert window.in_flight_bytes <= 200_000
        if is_acknowledged:
            oldest += 2
            window.acknowledged(key(min(oldest, number)), 400_000, 0)
        assert window.in_flight_bytes >= 0
    assert window.stalls == 0


def test_a_full_window_without_credit_is_taken_as_lost_after_50_ms() -> None:
    window = CreditWindow()
    window.acknowledged(key(0), 2 * COST, 0)
    window.sent(key(1), SIZE, 10 * MS)
    assert window.next_wake(SIZE, 10 * MS) == 60 * MS
    assert not window.may_send(SIZE, 60 * MS - 1)
    assert window.stalls == 0
    assert window.may_send(SIZE, 60 * MS)
    assert (window.stalls, window.in_flight_bytes) == (1, 0)
    assert window.next_wake(SIZE, 60 * MS) == 60 * MS
    window.sent(key(2), SIZE, 60 * MS)
    assert not window.may_send(SIZE, 60 * MS)


def test_a_credit_gives_a_full_window_more_time() -> None:
    window = CreditWindow()
    window.acknowledged(key(0), 4 * COST, 0)
    window.sent(key(1), SIZE, 0)
    window.sent(key(2), SIZE, 0)
    window.acknowledged(key(7), 4 * COST, 49 * MS)
    assert not window.may_send(SIZE, 51 * MS)
    assert window.stalls == 0


def test_after_a_stall_the_window_is_half_as_large_until_the_next_credit() -> None:
    window = CreditWindow()
    window.acknowledged(key(0), 16 * COST, 0)
    for number in range(1, 9):
        assert window.may_send(SIZE, 0)
        window.sent(key(number), SIZE, 0)
    for round_ms in (50, 100):
        for number in range(4):
            assert window.may_send(SIZE, round_ms * MS)
            window.sent(key(round_ms + number), SIZE, round_ms * MS)
        assert not window.may_send(SIZE, round_ms * MS)
    assert window.stalls == 2
    window.acknowledged(key(8), 16 * COST, 101 * MS)
    assert window.window_bytes == 8 * COST
    assert window.in_flight_bytes == 4 * COST


def test_credits_that_never_come_do_not_make_the_window_grow() -> None:
    window = CreditWindow()
    for number in range(10_000):
        window.sent(key(number), 1472, 0)
    assert window.in_flight_bytes == 4096 * kernel_bytes(1472)


def test_a_bucket_holds_its_burst_and_its_rate() -> None:
    bucket = TokenBucket(1e6, 3000)  # a byte a microsecond
    for _ in range(3):
        assert bucket.may_send(1000, 0)
        bucket.sent(1000, 0)
    assert not bucket.may_send(1000, 0)
    wake = bucket.next_wake(1000, 0)
    assert wake == pytest.approx(1 * MS, abs=2)
    assert not bucket.may_send(1000, wake - 1000)
    assert bucket.may_send(1000, wake)
    bucket.sent(1000, wake)
    assert bucket.may_send(3000, 1000 * MS)  # full again, and no fuller
    bucket.sent(3000, 1000 * MS)
    assert not bucket.may_send(1000, 1000 * MS)


def test_what_is_larger_than_the_bucket_goes_when_it_is_full() -> None:
    bucket = TokenBucket(1e6, 3000)
    assert bucket.may_send(5000, 0)
    bucket.sent(5000, 0)
    assert bucket.next_wake(5000, 0) == pytest.approx(5 * MS, abs=2)
    assert bucket.may_send(5000, 5 * MS)


def test_a_new_peer_gets_one_window_and_then_the_bucket() -> None:
    pacer = Pacer(TokenBucket(1e6, COST))
    assert pacer.may_send(SIZE, 0)
    pacer.sent(key(1), SIZE, 0)
    assert not pacer.may_send(SIZE, 0)
    assert pacer.next_wake(SIZE, 0) == 50 * MS
    assert pacer.may_send(SIZE, 50 * MS)
    pacer.sent(key(2), SIZE, 50 * MS)
    assert pacer.stalls == 1
    assert pacer.next_wake(SIZE, 50 * MS) == pytest.approx(50 * MS + COST * 1000, abs=2)


def test_a_new_peer_that_acknowledges_gets_its_own_window() -> None:
    pacer = Pacer(TokenBucket(1.0, 1))
    pacer.sent(key(1), SIZE, 0)
    pacer.acknowledged(key(1), 100 * COST, 0)
    for number in range(2, 52):
        assert pacer.may_send(SIZE, 0)
        pacer.sent(key(number), SIZE, 0)
    assert not pacer.may_send(SIZE, 0)
    assert pacer.stalls == 0


@pytest.mark.parametrize("size", [256, 1472, 9000, 16384, 65507])
def test_a_default_receive_buffer_holds_what_a_new_peer_gets_at_once(size: int) -> None:
    pacer = Pacer()
    taken_bytes = 0
    for number in range(10_000):
        if not pacer.may_send(size, 0):
            break
        pacer.sent(key(number), size, 0)
        taken_bytes += kernel_bytes(size)
    assert 0 < taken_bytes <= 212_992 // 2


def test_a_credit_brings_the_window_back_at_any_time() -> None:
    pacer = Pacer(TokenBucket(1.0, 1))
    sent = send_what_may_go(pacer, 0, 2000)
    assert len(sent) == 2  # what fits into a window, and one after the stall
    pacer.acknowledged(sent[-1], 4 * COST, 2000 * MS)
    assert len(send_what_may_go(pacer, 2001, 2010)) == 2


def send_what_may_go(pacer: Pacer, start_ms: int, end_ms: int) -> list[DatagramKey]:
    sent: list[DatagramKey] = []
    for now_ms in range(start_ms, end_ms):
        while pacer.may_send(SIZE, now_ms * MS):
            sent.append(key(now_ms * 10 + len(sent) % 10))
            pacer.sent(sent[-1], SIZE, now_ms * MS)
    return sent


def test_a_second_of_stalls_brings_the_bucket_back_and_a_credit_the_window() -> None:
    pacer = Pacer(TokenBucket(1e6, COST))
    pacer.acknowledged(key(0), 4 * COST, 0)
    assert len(send_what_may_go(pacer, 0, 1050)) == 2 + 20
    assert pacer.stalls == 20
    # The first stall was at 50 ms, so the one at 1050 is the last; a bucketful takes 67 ms.
    sent = send_what_may_go(pacer, 1050, 2050)
    assert 14 <= len(sent) <= 17
    assert pacer.stalls == 21
    pacer.acknowledged(sent[-1], 4 * COST, 2050 * MS)
    assert len(send_what_may_go(pacer, 2051, 2091)) == 2
    assert pacer.stalls == 21


def test_stalls_with_credits_between_them_do_not_bring_the_bucket_back() -> None:
    pacer = Pacer(TokenBucket(1.0, 1))
    pacer.acknowledged(key(0), 4 * COST, 0)
    for start_ms in range(0, 3000, 200):
        sent = send_what_may_go(pacer, start_ms, start_ms + 200)
        assert len(sent) >= 4  # at least one after each of three stalls
        pacer.acknowledged(sent[-1], 4 * COST, (start_ms + 200) * MS)


def test_a_peer_that_does_not_get_to_read_is_not_buried() -> None:
    window = CreditWindow()
    window.acknowledged(key(0), 16 * COST, 0)
    sent = 0
    for now_ms in range(0, 1000, 10):
        while window.may_send(SIZE, now_ms * MS):
            sent += 1
            window.sent(key(sent), SIZE, now_ms * MS)
    assert sent == 8 + 4 + 4 + (window.stalls - 2)
    assert window.stalls >= 15
