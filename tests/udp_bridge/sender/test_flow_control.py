# SPDX-License-Identifier: Apache-2.0
"""Times are milliseconds here, for readability."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from udp_bridge.sender.flow_control import CreditWindow, FlowControl, TokenBucket, kernel_bytes
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
def test_estimate_is_close_to_measured_kernel_memory(size: int, measured: int) -> None:
    assert kernel_bytes(size) >= measured * 0.99
    assert kernel_bytes(size) < 2 * measured


def test_one_datagram_may_always_go_when_none_is_in_flight() -> None:
    window = CreditWindow()
    window.acknowledged(key(0), 1000, 0)
    assert window.window_bytes == 500
    assert window.fits(SIZE)
    window.sent(key(1), 1, SIZE, SIZE, 0)
    assert not window.fits(20)


def test_a_credit_frees_its_datagram_and_all_before_it() -> None:
    window = CreditWindow()
    window.acknowledged(key(0), 8 * COST, 0)
    for number in range(1, 5):
        assert window.fits(SIZE)
        window.sent(key(number), 1, SIZE, SIZE, 0)
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
            window.sent(key(number), 1, size, size, 0)
        assert window.in_flight_bytes <= 200_000
        if is_acknowledged:
            oldest += 2
            window.acknowledged(key(min(oldest, number)), 400_000, 0)
        assert window.in_flight_bytes >= 0


def test_credits_that_never_come_do_not_make_the_window_grow() -> None:
    window = CreditWindow()
    for number in range(10_000):
        window.sent(key(number), 1, 1472, 1472, 0)
    assert window.in_flight_bytes == 4096 * kernel_bytes(1472)


def asks(flow: FlowControl, now: int) -> bool:
    """Ask for a Credit if the flow wants it; return whether it did."""
    if not flow.is_request_due(SIZE, now):
        return False
    flow.requested(DatagramKey(64, "", now, 0), 24, now)
    return True


def test_a_new_peer_gets_a_request_then_one_window_and_then_the_bucket() -> None:
    flow = FlowControl(TokenBucket(1e6, COST))
    assert flow.next_wake(SIZE, 5) == 5
    assert asks(flow, 5)
    assert not asks(flow, 5)
    assert flow.may_send(SIZE, 5)
    flow.sent(key(1), 1, SIZE, SIZE, 5)
    assert not flow.may_send(SIZE, 5)
    assert [now for now in range(5, 60 * MS, MS) if asks(flow, now)] == [
        10 * MS + 5,
        20 * MS + 5,
        30 * MS + 5,
        40 * MS + 5,
    ]
    assert flow.may_send(SIZE, 50 * MS + 5)
    assert flow.stalls == 4
    flow.sent(key(2), 1, SIZE, SIZE, 50 * MS + 5)
    assert flow.next_wake(SIZE, 60 * MS) == pytest.approx(50 * MS + COST * 1000, abs=10)
    assert not asks(flow, 2000 * MS)


def test_a_new_peer_reports_its_buffer_before_anything_is_sent() -> None:
    flow = FlowControl()
    assert asks(flow, 0)
    flow.acknowledged(DatagramKey(64, "", 0, 0), 16 * COST, 1)
    assert flow.allowed(SIZE, 100, 1) == 8
    assert (flow.stalls, flow.window.in_flight_bytes) == (0, 0)


def test_a_new_peer_that_acknowledges_gets_its_own_window() -> None:
    flow = FlowControl(TokenBucket(1.0, 1))
    flow.sent(key(1), 1, SIZE, SIZE, 0)
    flow.acknowledged(key(1), 100 * COST, 0)
    for number in range(2, 52):
        assert flow.may_send(SIZE, 0)
        flow.sent(key(number), 1, SIZE, SIZE, 0)
    assert not flow.may_send(SIZE, 0)
    assert flow.stalls == 0


@pytest.mark.parametrize("size", [256, 1472, 9000, 16384, 65507])
def test_default_receive_buffer_holds_the_first_window(size: int) -> None:
    flow = FlowControl()
    taken_bytes = 0
    for number in range(10_000):
        if not flow.may_send(size, 0):
            break
        flow.sent(key(number), 1, size, size, 0)
        taken_bytes += kernel_bytes(size)
    assert 0 < taken_bytes <= 212_992 // 2


def full(buffer_datagrams: int) -> FlowControl:
    """Return a flow whose peer's window was filled at time 0."""
    flow = FlowControl(TokenBucket(1e6, COST))
    flow.acknowledged(key(0), buffer_datagrams * COST, 0)
    number = 1
    while flow.may_send(SIZE, 0):
        flow.sent(key(number), 1, SIZE, SIZE, 0)
        number += 1
    return flow


def test_a_credit_is_requested_every_10_ms_while_a_full_window_does_not_move() -> None:
    flow = full(8)
    assert flow.next_wake(SIZE, 0) == 10 * MS
    assert [now for now in range(0, 45 * MS, MS) if asks(flow, now)] == [
        number * 10 * MS for number in range(1, 5)
    ]
    assert not flow.may_send(SIZE, 45 * MS)
    assert flow.stalls == 4


def test_a_credit_gives_a_full_window_more_time() -> None:
    flow = full(8)
    flow.acknowledged(key(1), 6 * COST, 9 * MS)
    assert not flow.may_send(SIZE, 11 * MS)
    assert not asks(flow, 11 * MS)
    assert asks(flow, 19 * MS)


def test_the_credit_for_the_asking_frees_all_that_was_sent_before() -> None:
    flow = full(8)
    assert asks(flow, 10 * MS)
    flow.acknowledged(DatagramKey(64, "", 10 * MS, 0), 8 * COST, 11 * MS)
    assert flow.window.in_flight_bytes == 0
    assert flow.allowed(SIZE, 100, 11 * MS) == 4


def test_a_peer_that_does_not_get_to_read_is_sent_nothing() -> None:
    flow = full(8)
    for now in range(0, 1010 * MS, MS):
        asks(flow, now)
        assert not flow.may_send(SIZE, now)
    assert flow.stalls == 100


def test_unanswered_requests_enable_the_bucket_and_a_credit_the_window() -> None:
    flow = full(8)
    sent: list[int] = []
    for now in range(0, 2010 * MS, MS):
        asks(flow, now)
        if flow.may_send(SIZE, now):
            sent.append(now)
            flow.sent(key(100 + len(sent)), 1, SIZE, SIZE, now)
    assert sent[0] == 1010 * MS  # the first asking was at 10 ms
    assert 14 <= len(sent) <= 17  # a bucketful takes 66 ms
    flow.acknowledged(key(100 + len(sent)), 8 * COST, 2010 * MS)
    assert flow.allowed(SIZE, 100, 2010 * MS) == 4


def test_stalls_with_credits_between_them_do_not_bring_the_bucket() -> None:
    flow = full(4)
    number = 100
    for now in range(0, 5000 * MS, MS):
        asks(flow, now)
        if now % (900 * MS) == 899 * MS:
            flow.acknowledged(key(number), 4 * COST, now)
            while flow.may_send(SIZE, now):
                number += 1
                flow.sent(key(number), 1, SIZE, SIZE, now)
        else:
            assert not flow.may_send(SIZE, now)


def test_credit_beyond_flight_is_ignored() -> None:
    flow = FlowControl()
    flow.requested(key(0), 100, 0)
    flow.credited(key(0), 1 << 20, 0)
    window_bytes = flow.window.window_bytes
    flow.sent(key(1), 3, 1000, 1000, 0)
    in_flight_bytes = flow.window.in_flight_bytes
    forged = (key(0), key(4), key(2)._replace(topic="/other"), key(2)._replace(seq_number=9))
    for one in forged:
        flow.credited(one, 0, 0)
        assert (flow.window.window_bytes, flow.window.in_flight_bytes) == (
            window_bytes,
            in_flight_bytes,
        )
    flow.credited(key(2), 1 << 21, 0)
    assert flow.window.window_bytes == 1 << 20
    assert flow.window.in_flight_bytes == in_flight_bytes // 3


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


def test_message_larger_than_the_bucket_is_sent_when_full() -> None:
    bucket = TokenBucket(1e6, 3000)
    assert bucket.may_send(5000, 0)
    bucket.sent(5000, 0)
    assert bucket.next_wake(5000, 0) == pytest.approx(5 * MS, abs=2)
    assert bucket.may_send(5000, 5 * MS)
