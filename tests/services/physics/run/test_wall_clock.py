# SPDX-License-Identifier: Apache-2.0
import random
from itertools import pairwise

import pytest

from groundlink.core.clock import TICK_RATE_HZ, TICK_SECONDS
from services.physics.run.wall_clock import NoWallClock, RealTimeFactorMeter, WallClock

CATCH_UP = 0.2


@pytest.fixture
def wall_clock() -> WallClock:
    return WallClock(1.0, CATCH_UP)


def test_a_tick_is_due_by_its_number(wall_clock: WallClock) -> None:
    assert wall_clock.late_seconds(1, 100.0) == 0.0
    assert wall_clock.late_seconds(2, 100.0) == pytest.approx(-0.0025)
    assert wall_clock.late_seconds(401, 100.9) == pytest.approx(-0.1)
    assert wall_clock.late_seconds(401, 101.05) == pytest.approx(0.05)


@pytest.mark.parametrize(("factor", "late"), [(2.0, -0.5), (0.5, -2.0)])
def test_a_factor_shrinks_or_stretches_ticks(factor: float, late: float) -> None:
    wall_clock = WallClock(factor, CATCH_UP)
    wall_clock.late_seconds(0, 0.0)
    assert wall_clock.late_seconds(400, 0.0) == pytest.approx(late)


def test_short_delay_is_caught_up(wall_clock: WallClock) -> None:
    wall_clock.late_seconds(0, 0.0)
    assert wall_clock.lost_seconds(1, 0.9 * CATCH_UP) == 0.0
    assert wall_clock.late_seconds(400, 0.9 * CATCH_UP) == pytest.approx(0.9 * CATCH_UP - 1.0)


def test_long_delay_is_written_off_without_slew(wall_clock: WallClock) -> None:
    wall_clock.late_seconds(0, 0.0)
    lost = 5.0 - TICK_SECONDS - CATCH_UP
    assert wall_clock.lost_seconds(1, 5.0) == pytest.approx(lost)
    assert wall_clock.written_off_seconds == pytest.approx(lost)
    assert wall_clock.debt_seconds(1) == 0.0
    assert wall_clock.late_seconds(1, 5.0) == pytest.approx(CATCH_UP)
    assert wall_clock.late_seconds(2, 5.0) == pytest.approx(CATCH_UP - TICK_SECONDS)


@pytest.mark.parametrize("factor", [0.5, 1.0, 3.0])
def test_a_debt_is_paid_by_ticks_that_are_due_faster(factor: float) -> None:
    wall_clock = WallClock(factor, CATCH_UP, slew=0.05, most_debt_seconds=5.0)
    wall_clock.late_seconds(0, 0.0)
    now = CATCH_UP + 0.4
    assert wall_clock.lost_seconds(0, now) == pytest.approx(0.4)
    ticks = round(0.4 * 21 / TICK_SECONDS * factor)  # 5 % of 20/21 of the time
    dues = [now - wall_clock.late_seconds(tick, now) for tick in range(2 * ticks)]
    tick_seconds = TICK_SECONDS / factor
    slewed = [later - due for due, later in pairwise(dues[: ticks - 1])]
    assert slewed == pytest.approx([tick_seconds / 1.05] * len(slewed))
    assert dues[ticks + 1 :] == pytest.approx(
        [tick * tick_seconds for tick in range(ticks + 1, 2 * ticks)]
    ), "it is due again as if nothing had been"


def test_delay_is_written_off_once() -> None:
    """Ticks that come late pay nothing back, so what is lost is what sim time lacks."""
    wall_clock = WallClock(1.0, CATCH_UP, slew=0.05, most_debt_seconds=100.0)
    wall_clock.late_seconds(0, 0.0)
    lost = sum(wall_clock.lost_seconds(tick, tick * 2 * TICK_SECONDS) for tick in range(4000))
    assert lost == pytest.approx(4000 * TICK_SECONDS - CATCH_UP, abs=0.01)
    assert wall_clock.debt_seconds(3999) == pytest.approx(lost)


def test_large_delay_is_written_off_completely() -> None:
    wall_clock = WallClock(1.0, CATCH_UP, slew=0.05, most_debt_seconds=5.0)
    wall_clock.late_seconds(0, 0.0)
    assert wall_clock.lost_seconds(0, 4.0 + CATCH_UP) == pytest.approx(4.0)
    assert wall_clock.written_off_seconds == 0.0
    assert wall_clock.lost_seconds(1, 6.0 + CATCH_UP) == pytest.approx(2.0, abs=0.01)
    assert wall_clock.debt_seconds(1) == 0.0
    assert wall_clock.written_off_seconds == pytest.approx(6.0, abs=0.01)
    assert wall_clock.late_seconds(1, 6.0 + CATCH_UP) == pytest.approx(CATCH_UP)


def test_time_that_stood_still_is_not_made_up_for(wall_clock: WallClock) -> None:
    wall_clock.late_seconds(0, 0.0)
    wall_clock.restart()
    assert wall_clock.late_seconds(1, 9.0) == 0.0
    assert wall_clock.late_seconds(2, 9.0) == pytest.approx(-TICK_SECONDS)


def test_without_a_wall_every_tick_is_due() -> None:
    wall_clock = NoWallClock()
    for now in (0.0, 5.0, 1e6):
        assert wall_clock.late_seconds(10**9, now) == 0.0
        assert wall_clock.lost_seconds(10**9, now) == 0.0


@pytest.mark.parametrize("factor", [1.0, 0.3])
def test_an_hour_of_late_wake_ups_adds_no_drift(factor: float) -> None:
    """Each sleep is too long, most by 0.1 ms, some by 50 ms; the last tick is due to the ms."""
    wall_clock = WallClock(factor, CATCH_UP)
    chance = random.Random(8)
    begin = now = 1_234_567.891  # what a monotonic clock shows after two weeks
    ticks = round(3600 * TICK_RATE_HZ * factor)
    tick = 0
    while tick < ticks:
        late = wall_clock.late_seconds(tick + 1, now)
        if late < 0:
            now += -late + chance.expovariate(1e4) + 0.05 * (chance.random() < 1e-4)
            continue
        assert wall_clock.lost_seconds(tick + 1, now) == 0.0
        tick += 1
        now += 30e-6 / factor  # the step itself
    assert now - begin == pytest.approx(3600, abs=0.06), "the last wake-up may be one of those"
    assert wall_clock.late_seconds(ticks, begin + 3600) == pytest.approx(
        TICK_SECONDS / factor, abs=1e-4
    )


def test_the_real_time_factor_is_sim_over_wall_since_the_last_look() -> None:
    factor = RealTimeFactorMeter()
    assert factor.since_last(0, 10.0) is None
    assert factor.since_last(200, 11.0) == pytest.approx(0.5)
    assert factor.since_last(1000, 12.0) == pytest.approx(2.0)
    assert factor.since_last(0, 13.0) is None, "the run began again"
    assert factor.since_last(0, 13.0) is None, "no time has passed"
