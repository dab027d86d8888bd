# SPDX-License-Identifier: Apache-2.0
import pytest

from udp_bridge.receiver.round_trip import RoundTrip

MS = 1_000_000


def test_equal_round_trips_leave_no_doubt() -> None:
    known = RoundTrip()
    for _ in range(60):
        known.add(100 * MS)
    assert known.nanos == 100 * MS
    assert known.upper_nanos == pytest.approx(100 * MS, rel=1e-6)


def test_the_usual_round_trip_is_above_the_mean_by_the_deviation() -> None:
    known = RoundTrip()
    for _ in range(200):
        known.add(90 * MS)
        known.add(110 * MS)
    assert known.nanos == pytest.approx(100 * MS, rel=0.02)
    assert known.upper_nanos == pytest.approx(110 * MS, rel=0.02)
