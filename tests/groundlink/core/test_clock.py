# SPDX-License-Identifier: Apache-2.0
import math
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundlink.core.clock import NANOS, TICK_NANOS, TICK_RATE_HZ, TICK_SECONDS, Schedule, exact

DAY_SECONDS = 86_400
RATES = [400.0, 100.0, 50.0, 30.0, 29.97, 10.0, 7.3, 1.0, 0.1]

rates = st.one_of(
    st.sampled_from(RATES),
    st.decimals(min_value="0.001", max_value="400", places=3).map(float),
)


def test_a_tick_is_two_and_a_half_milliseconds() -> None:
    assert TICK_RATE_HZ == 400
    assert TICK_RATE_HZ * TICK_NANOS == NANOS
    assert TICK_SECONDS == pytest.approx(0.0025, rel=1e-15)


@pytest.mark.parametrize(
    ("value", "fraction"),
    [
        (29.97, Fraction(2997, 100)),
        (30.0, Fraction(30)),
        (0.1, Fraction(1, 10)),
        (1e-7, Fraction(1, 10**7)),
    ],
)
def test_a_rate_means_the_decimal_that_was_written(value: float, fraction: Fraction) -> None:
    assert exact(value) == fraction
    assert Schedule.at(value).rate_hz == fraction


def test_30_hz_from_400_hz() -> None:
    schedule = Schedule.at(30.0)
    assert [schedule.tick(i) for i in range(7)] == [0, 14, 27, 40, 54, 67, 80]
    assert [schedule.nanos(i) for i in range(4)] == [0, 33_333_333, 66_666_666, 100_000_000]


def test_400_hz_is_every_tick() -> None:
    schedule = Schedule.at(400.0)
    for i in (0, 1, 2, 399, 34_560_000):
        assert (schedule.tick(i), schedule.nanos(i)) == (i, i * TICK_NANOS)
        assert schedule.first_at_or_after(i) == i


@given(rate_hz=rates, index=st.integers(0, 10**9))
def test_events_are_where_exact_arithmetic_puts_them(rate_hz: float, index: int) -> None:
    schedule = Schedule.at(rate_hz)
    seconds = index / Fraction(str(rate_hz))
    assert schedule.nanos(index) == math.floor(seconds * 10**9)
    assert schedule.tick(index) == math.ceil(seconds * 400)
    assert schedule.tick(index) * TICK_NANOS >= schedule.nanos(index)


@given(rate_hz=rates, tick=st.integers(0, 10**9))
def test_first_at_or_after_inverts_the_instants(rate_hz: float, tick: int) -> None:
    schedule = Schedule.at(rate_hz)
    index = schedule.first_at_or_after(tick)
    instant = Fraction(tick, 400)
    assert index / Fraction(str(rate_hz)) >= instant
    assert schedule.tick(index) >= tick
    assert schedule.nanos(index) >= tick * TICK_NANOS
    if index > 0:
        assert (index - 1) / Fraction(str(rate_hz)) < instant


@given(rate_hz=rates, index=st.integers(0, 10**9))
def test_an_event_is_the_first_at_or_after_its_tick_or_just_before_it(
    rate_hz: float, index: int
) -> None:
    schedule = Schedule.at(rate_hz)
    tick = schedule.tick(index)
    happens_at_tick = index * 400 / Fraction(str(rate_hz)) == tick
    assert schedule.first_at_or_after(tick) == (index if happens_at_tick else index + 1)


@pytest.mark.parametrize("rate_hz", RATES)
def test_no_drift_over_a_day(rate_hz: float) -> None:
    schedule = Schedule.at(rate_hz)
    events = Fraction(str(rate_hz)) * DAY_SECONDS
    assert events.denominator == 1
    assert schedule.nanos(int(events)) == DAY_SECONDS * NANOS
    assert schedule.tick(int(events)) == DAY_SECONDS * TICK_RATE_HZ
    assert schedule.first_at_or_after(DAY_SECONDS * TICK_RATE_HZ) == events


@pytest.mark.parametrize("rate_hz", [400.0, 399.9, 29.97])
def test_no_two_events_share_a_tick(rate_hz: float) -> None:
    schedule = Schedule.at(rate_hz)
    ticks = [schedule.tick(i) for i in range(5000)]
    assert len(set(ticks)) == len(ticks)


@given(rates, st.integers(0, 10**6), st.integers(1, 50))
def test_events_between_two_others(rate_hz: float, first: int, steps: int) -> None:
    schedule = Schedule.at(rate_hz)
    last = schedule.tick(first + steps)
    assert schedule.between(schedule.tick(first), last) == steps - 1
    assert schedule.between(last, last) == schedule.between(last, schedule.tick(first)) == 0
