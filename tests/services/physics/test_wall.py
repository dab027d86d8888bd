# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import random

import pytest

from groundlink.clock import TICK_RATE_HZ, TICK_SECONDS
from services.physics.wall import NoWall, RealTimeFactor, Wall

CATCH_UP = 0.2


@pytest.fixture
def wall() -> Wall:
    return Wall(1.0, CATCH_UP)


def test_a_tick_is_due_by_its_number(wall: Wall) -> None:
    assert wall.late_seconds(1, 100.0) == 0.0
    assert wall.late_seconds(2, 100.0) == pytest.approx(-0.0025)
    assert wall.late_seconds(401, 100.9) == pytest.approx(-0.1)
    assert wall.late_seconds(401, 101.05) == pytest.approx(0.05)


@pytest.mark.parametrize(("factor", "late"), [(2.0, -0.5), (0.5, -2.0)])
def test_a_factor_shrinks_or_stretches_ticks(factor: float, late: float) -> None:
    wall = Wall(factor, CATCH_UP)
    wall.late_seconds(0, 0.0)
    assert wall.late_seconds(400, 0.0) == pytest.approx(late)


def test_what_is_late_for_a_moment_is_made_up_for(wall: Wall) -> None:
    wall.late_seconds(0, 0.0)
    assert wall.stretched_seconds(1, 0.9 * CATCH_UP) == 0.0
    assert wall.late_seconds(400, 0.9 * CATCH_UP) == pytest.approx(0.9 * CATCH_UP - 1.0)


def test_what_is_later_is_given_up(wall: Wall) -> None:
    wall.late_seconds(0, 0.0)
    assert wall.stretched_seconds(1, 5.0) == pytest.approx(5.0 - TICK_SECONDS)
    assert wall.late_seconds(1, 5.0) == pytest.approx(0.0)
    assert wall.late_seconds(2, 5.0) == pytest.approx(-TICK_SECONDS)


def test_time_that_stood_still_is_not_made_up_for(wall: Wall) -> None:
    wall.late_seconds(0, 0.0)
    wall.hold()
    assert wall.late_seconds(1, 9.0) == 0.0
    assert wall.late_seconds(2, 9.0) == pytest.approx(-TICK_SECONDS)


def test_without_a_wall_every_tick_is_due() -> None:
    wall = NoWall()
    for now in (0.0, 5.0, 1e6):
        assert wall.late_seconds(10**9, now) == 0.0
        assert wall.stretched_seconds(10**9, now) == 0.0


@pytest.mark.parametrize("factor", [1.0, 0.3])
def test_an_hour_of_late_wake_ups_adds_no_drift(factor: float) -> None:
    """Each sleep is too long, most by 0.1 ms, some by 50 ms; the last tick is due to the ms."""
    wall = Wall(factor, CATCH_UP)
    chance = random.Random(8)
    begin = now = 1_234_567.891  # what a monotonic clock shows after two weeks
    ticks = round(3600 * TICK_RATE_HZ * factor)
    tick = 0
    while tick < ticks:
        late = wall.late_seconds(tick + 1, now)
        if late < 0:
            now += -late + chance.expovariate(1e4) + 0.05 * (chance.random() < 1e-4)
            continue
        assert wall.stretched_seconds(tick + 1, now) == 0.0
        tick += 1
        now += 30e-6 / factor  # the step itself
    assert now - begin == pytest.approx(3600, abs=0.06), "the last wake-up may be one of those"
    assert wall.late_seconds(ticks, begin + 3600) == pytest.approx(TICK_SECONDS / factor, abs=1e-4)


def test_the_real_time_factor_is_sim_over_wall_since_the_last_look() -> None:
    factor = RealTimeFactor()
    assert factor.since_last(0, 10.0) is None
    assert factor.since_last(200, 11.0) == pytest.approx(0.5)
    assert factor.since_last(1000, 12.0) == pytest.approx(2.0)
    assert factor.since_last(0, 13.0) is None, "the run began again"
    assert factor.since_last(0, 13.0) is None, "no time has passed"
