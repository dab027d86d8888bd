# SPDX-License-Identifier: Apache-2.0
"""Times are milliseconds here, for readability."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from udp_bridge.sender.credit_window import CreditWindow, Pacer, kernel_bytes
from udp_bridge.sender.token_bucket import TokenBucket
from udp_bridge.wire.message import DatagramKey

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
    assert window.fits(SIZE)
    window.sent(key(1), SIZE, 0)
    assert not window.fits(20)


def test_a_credit_frees_its_datagram_and_all_before_it() -> None:
    window = CreditWindow()
    window.acknowledged(key(0), 8 * COST, 0)
    for number in range(1, 5):
        assert window.fits(SIZE)
        window.sent(key(number), SIZE, 0)
    assert window.in_flight_bytes == 4 * COST
    assert not window.fits(SIZE)
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
        if window.fits(size):
            window.sent(key(number), size, 0)
        assert window.in_flight_bytes <= 200_000
        if is_acknowledged:
            oldest += 2
            window.acknowledged(key(min(oldest, number)), 400_000, 0)
        assert window.in_flight_bytes >= 0


def test_credits_that_never_come_do_not_make_the_window_grow() -> None:
    window = CreditWindow()
    for number in range(10_000):
        window.sent(key(number), 1472, 0)
    assert window.in_flight_bytes == 4096 * kernel_bytes(1472)


def asks(pacer: Pacer, now: int) -> bool:
    """Ask for a Credit if the pacer wants it; return whether it did."""
    if not pacer.must_ask(SIZE, now):
        return False
    pacer.asked(DatagramKey(64, "", now, 0), 24, now)
    return True


def test_a_new_peer_is_asked_first_then_gets_one_window_and_then_the_bucket() -> None:
    pacer = Pacer(TokenBucket(1e6, COST))
    assert pacer.next_wake(SIZE, 5) == 5
    assert asks(pacer, 5)
    assert not asks(pacer, 5)
    assert pacer.may_send(SIZE, 5)
    pacer.sent(key(1), SIZE, 5)
    assert not pacer.may_send(SIZE, 5)
    assert [now for now in range(5, 60 * MS, MS) if asks(pacer, now)] == [
        10 * MS + 5,
        20 * MS + 5,
        30 * MS + 5,
        40 * MS + 5,
    ]
    assert pacer.may_send(SIZE, 50 * MS + 5)
    assert pacer.stalls == 4
    pacer.sent(key(2), SIZE, 50 * MS + 5)
    assert pacer.next_wake(SIZE, 60 * MS) == pytest.approx(50 * MS + COST * 1000, abs=10)
    assert not asks(pacer, 2000 * MS)


def test_a_new_peer_tells_how_large_its_buffer_is_before_anything_is_sent() -> None:
    pacer = Pacer()
    assert asks(pacer, 0)
    pacer.acknowledged(DatagramKey(64, "", 0, 0), 16 * COST, 1)
    assert pacer.granted(SIZE, 100, 1) == 8
    assert (pacer.stalls, pacer.window.in_flight_bytes) == (0, 0)


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


def full(buffer_datagrams: int) -> Pacer:
    """Return a pacer whose peer's window was filled at time 0."""
    pacer = Pacer(TokenBucket(1e6, COST))
    pacer.acknowledged(key(0), buffer_datagrams * COST, 0)
    number = 1
    while pacer.may_send(SIZE, 0):
        pacer.sent(key(number), SIZE, 0)
        number += 1
    return pacer


def test_a_full_window_that_stands_still_is_asked_about_every_10_ms() -> None:
    pacer = full(8)
    assert pacer.next_wake(SIZE, 0) == 10 * MS
    assert [now for now in range(0, 45 * MS, MS) if asks(pacer, now)] == [
        number * 10 * MS for number in range(1, 5)
    ]
    assert not pacer.may_send(SIZE, 45 * MS)
    assert pacer.stalls == 4


def test_a_credit_gives_a_full_window_more_time() -> None:
    pacer = full(8)
    pacer.acknowledged(key(1), 6 * COST, 9 * MS)
    assert not pacer.may_send(SIZE, 11 * MS)
    assert not asks(pacer, 11 * MS)
    assert asks(pacer, 19 * MS)


def test_the_credit_for_the_asking_frees_all_that_was_sent_before() -> None:
    pacer = full(8)
    assert asks(pacer, 10 * MS)
    pacer.acknowledged(DatagramKey(64, "", 10 * MS, 0), 8 * COST, 11 * MS)
    assert pacer.window.in_flight_bytes == 0
    assert pacer.granted(SIZE, 100, 11 * MS) == 4


def test_a_peer_that_does_not_get_to_read_is_sent_nothing() -> None:
    pacer = full(8)
    for now in range(0, 1010 * MS, MS):
        asks(pacer, now)
        assert not pacer.may_send(SIZE, now)
    assert pacer.stalls == 100


def test_a_second_of_asking_in_vain_brings_the_bucket_and_a_credit_the_window() -> None:
    pacer = full(8)
    sent: list[int] = []
    for now in range(0, 2010 * MS, MS):
        asks(pacer, now)
        if pacer.may_send(SIZE, now):
            sent.append(now)
            pacer.sent(key(100 + len(sent)), SIZE, now)
    assert sent[0] == 1010 * MS  # the first asking was at 10 ms
    assert 14 <= len(sent) <= 17  # a bucketful takes 66 ms
    pacer.acknowledged(key(100 + len(sent)), 8 * COST, 2010 * MS)
    assert pacer.granted(SIZE, 100, 2010 * MS) == 4


def test_stalls_with_credits_between_them_do_not_bring_the_bucket() -> None:
    pacer = full(4)
    number = 100
    for now in range(0, 5000 * MS, MS):
        asks(pacer, now)
        if now % (900 * MS) == 899 * MS:
            pacer.acknowledged(key(number), 4 * COST, now)
            while pacer.may_send(SIZE, now):
                number += 1
                pacer.sent(key(number), SIZE, now)
        else:
            assert not pacer.may_send(SIZE, now)


def test_a_credit_for_what_is_not_in_flight_changes_nothing() -> None:
    pacer = Pacer()
    pacer.asked(key(0), 100, 0)
    pacer.credited(key(0), 1 << 20, 0)
    window_bytes = pacer.window.window_bytes
    pacer.sent_run(key(1), 3, 1000, 1000, 0)
    in_flight_bytes = pacer.window.in_flight_bytes
    forged = (key(0), key(4), key(2)._replace(topic="/other"), key(2)._replace(seq_number=9))
    for one in forged:
        pacer.credited(one, 0, 0)
        assert (pacer.window.window_bytes, pacer.window.in_flight_bytes) == (
            window_bytes,
            in_flight_bytes,
        )
    pacer.credited(key(2), 1 << 21, 0)
    assert pacer.window.window_bytes == 1 << 20
    assert pacer.window.in_flight_bytes == in_flight_bytes // 3
