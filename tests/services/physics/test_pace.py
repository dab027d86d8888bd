# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import pytest

from groundlink.messages import Ack
from groundlink.scenario.route import (
    COMMAND_AHEAD_TICKS,
    DRIVER_PERIOD_TICKS,
    DRIVER_WINDOW_TICKS,
)
from services.physics.pace import CATCH_UP_SECONDS, AsFastAsOthers, Promises, RealTime


def test_real_time_waits_until_a_tick_is_due() -> None:
    pace = RealTime(1.0)
    assert pace.wait_seconds(1, 100.0) == 0.0
    assert pace.wait_seconds(2, 100.0) == pytest.approx(0.0025)
    assert pace.wait_seconds(401, 100.9) == pytest.approx(0.1)
    assert pace.wait_seconds(401, 101.05) == 0.0


def test_a_factor_stretches_or_shrinks_ticks() -> None:
    for factor, wait in [(2.0, 0.5), (0.5, 2.0)]:
        pace = RealTime(factor)
        pace.wait_seconds(0, 0.0)
        assert pace.wait_seconds(400, 0.0) == pytest.approx(wait)


def test_a_short_hold_up_is_made_up_for() -> None:
    pace = RealTime(1.0)
    pace.wait_seconds(0, 0.0)
    late = 0.9 * CATCH_UP_SECONDS
    assert pace.wait_seconds(1, late) == 0.0
    assert pace.wait_seconds(400, late) == pytest.approx(1.0 - late)
    assert pace.stretched_seconds == 0.0


def test_after_a_long_hold_up_time_has_stretched() -> None:
    pace = RealTime(1.0)
    pace.wait_seconds(0, 0.0)
    assert pace.wait_seconds(1, 5.0) == 0.0
    assert pace.wait_seconds(2, 5.0) == pytest.approx(0.0025)
    assert pace.stretched_seconds == pytest.approx(5.0 - 0.0025)


EPOCH = 7


@pytest.fixture
def pace() -> AsFastAsOthers:
    return AsFastAsOthers({"rover/imu": 100, "rover/lidar": 100}, 100, EPOCH)


def ack(pace: AsFastAsOthers, process: str, tick: int, epoch: int = EPOCH) -> None:
    pace.acknowledged(process, Ack(epoch, tick, tick))


def test_nothing_moves_before_every_sensor_has_joined(pace: AsFastAsOthers) -> None:
    assert pace.wait_seconds(1, 0.0) > 0
    assert pace.missing() == ["rover/imu", "rover/lidar"]
    ack(pace, "rover/imu", -1)
    assert pace.missing() == ["rover/lidar"]
    ack(pace, "rover/lidar", -1)
    assert pace.wait_seconds(1, 0.0) == 0.0


def test_physics_is_at_most_a_window_ahead(pace: AsFastAsOthers) -> None:
    ack(pace, "rover/imu", 1000)
    ack(pace, "rover/lidar", 50)
    assert pace.wait_seconds(150, 0.0) == 0.0
    assert pace.wait_seconds(151, 0.0) > 0.0
    assert pace.missing() == ["rover/lidar"]
    ack(pace, "rover/lidar", 51)
    assert pace.wait_seconds(151, 0.0) == 0.0


def test_a_gateway_is_waited_for_while_it_is_there(pace: AsFastAsOthers) -> None:
    ack(pace, "rover/imu", 1000)
    ack(pace, "rover/lidar", 1000)
    ack(pace, "gateway", 10)
    assert pace.wait_seconds(500, 0.0) > 0.0
    pace.left("gateway")
    assert pace.wait_seconds(500, 0.0) == 0.0


def test_a_sensor_that_left_is_waited_for(pace: AsFastAsOthers) -> None:
    ack(pace, "rover/imu", 1000)
    ack(pace, "rover/lidar", 10)
    pace.left("rover/lidar")
    assert pace.wait_seconds(500, 0.0) > 0.0


def test_words_from_an_earlier_life_do_not_count(pace: AsFastAsOthers) -> None:
    ack(pace, "rover/imu", 1000, epoch=EPOCH - 1)
    assert "rover/imu" in pace.missing()


def test_without_sensors_nobody_is_waited_for() -> None:
    assert AsFastAsOthers({}, 1, EPOCH).wait_seconds(10**6, 0.0) == 0.0


def test_each_process_has_a_window_of_its_own() -> None:
    pace = AsFastAsOthers({"rover/imu": 100, "rover/driver": 8}, 50, EPOCH)
    ack(pace, "rover/imu", 0)
    ack(pace, "rover/driver", 0)
    assert pace.wait_seconds(8, 0.0) == 0.0
    assert pace.wait_seconds(9, 0.0) > 0.0
    assert pace.missing() == ["rover/driver"]
    ack(pace, "rover/driver", 1000)
    assert pace.wait_seconds(100, 0.0) == 0.0
    ack(pace, "gateway", 0)
    assert pace.wait_seconds(50, 0.0) == 0.0
    assert pace.wait_seconds(51, 0.0) > 0.0
    assert pace.missing() == ["gateway"]


def test_a_step_in_which_a_drivers_command_acts_waits_for_that_command() -> None:
    pace = AsFastAsOthers({"rover/driver": DRIVER_WINDOW_TICKS}, 400, EPOCH)
    assert pace.wait_seconds(1, 0.0) > 0.0
    for answered in range(-DRIVER_PERIOD_TICKS, 80, DRIVER_PERIOD_TICKS):
        ack(pace, "rover/driver", answered)
        due = answered + DRIVER_PERIOD_TICKS
        assert pace.wait_seconds(due, 0.0) == 0.0, "it never sees the state to answer"
        acts = due + COMMAND_AHEAD_TICKS  # the tick that the command for `due` is stamped with
        assert pace.wait_seconds(acts, 0.0) == 0.0
        assert pace.wait_seconds(acts + 1, 0.0) > 0.0


def test_a_drivers_word_counts_when_its_command_is_here() -> None:
    promises = Promises({"rover/driver": "rover"})
    promises.given("rover/driver", Ack(EPOCH, -8, -1))
    assert list(promises.kept()) == [("rover/driver", Ack(EPOCH, -8, -1))]
    promises.given("rover/driver", Ack(EPOCH, 8, 16))
    promises.given("rover/imu", Ack(EPOCH, 50, 40))
    assert [name for name, _ in promises.kept()] == ["rover/imu"]
    promises.commanded("rover", 8)
    promises.commanded("other", 16)
    assert list(promises.kept()) == []
    promises.commanded("rover", 16)
    assert list(promises.kept()) == [("rover/driver", Ack(EPOCH, 8, 16))]
    assert list(promises.kept()) == []


def test_who_is_not_needed_any_more_is_not_waited_for() -> None:
    pace = AsFastAsOthers({"rover/imu": 8, "second/imu": 8}, 8, EPOCH)
    for name in ("rover/imu", "second/imu"):
        pace.acknowledged(name, Ack(EPOCH, 0, 0))
    assert pace.wait_seconds(9, 0.0) > 0
    assert pace.missing() == ["rover/imu", "second/imu"]
    pace.only(("rover/imu",))
    assert pace.missing() == ["rover/imu"]
    pace.acknowledged("rover/imu", Ack(EPOCH, 8, 8))
    assert pace.wait_seconds(9, 0.0) == 0
