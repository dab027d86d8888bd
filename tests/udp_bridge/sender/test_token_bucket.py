# SPDX-License-Identifier: Apache-2.0
"""Times are milliseconds here, for readability."""

from __future__ import annotations

import pytest

from udp_bridge.sender.token_bucket import TokenBucket

MS = 1_000_000


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
