# SPDX-License-Identifier: Apache-2.0
import pytest

from udp_bridge.node.subscriptions import MAX_WAIT_NANOS, NANOS, Lease, RosSample
from udp_bridge.wire.control import Subscribe


def sample(number: int) -> RosSample:
    return RosSample("", None, bytes([number]))


def lease(*, lease_s: int = 0, max_rate_hz: float = 0.0) -> Lease:
    made = Lease()
    made.renew(Subscribe(9, lease_s=lease_s, max_rate_hz=max_rate_hz), 0)
    return made


@pytest.mark.parametrize(
    ("lease_s", "now_nanos", "has_expired"),
    [(0, 1000 * NANOS, False), (3, 3 * NANOS - 1, False), (3, 3 * NANOS, True)],
)
def test_lease(lease_s: int, now_nanos: int, has_expired: bool) -> None:
    assert lease(lease_s=lease_s).has_expired(now_nanos) is has_expired


def test_renewed_lease_restarts() -> None:
    renewed = lease(lease_s=2)
    renewed.renew(Subscribe(9, lease_s=2), NANOS)
    assert not renewed.has_expired(3 * NANOS - 1)
    assert renewed.has_expired(3 * NANOS)


def test_without_a_limit_each_message_goes_at_once() -> None:
    free = lease()
    for number in range(3):
        free.offer(sample(number))
        assert free.take(number) == sample(number)
        assert free.take(number) is None


def test_the_rate_is_kept_and_the_last_message_is_never_lost() -> None:
    limited = lease(max_rate_hz=10.0)
    taken = []
    for millisecond in range(0, 400):
        if millisecond % 20 == 0 and millisecond < 300:
            limited.offer(sample(millisecond // 20))
        sent = limited.take(millisecond * 1_000_000)
        if sent is not None:
            taken.append((millisecond, sent.body[0]))
    assert taken == [(0, 0), (100, 5), (200, 10), (300, 14)]


def test_wait() -> None:
    limited = lease(max_rate_hz=10.0)
    assert limited.wait_nanos(0) == MAX_WAIT_NANOS
    limited.offer(sample(0))
    assert limited.wait_nanos(0) == 0
    limited.take(0)
    limited.offer(sample(1))
    assert limited.wait_nanos(30_000_000) == 70_000_000
    assert limited.wait_nanos(2 * NANOS) == 0
