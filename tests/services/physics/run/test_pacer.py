# SPDX-License-Identifier: Apache-2.0
"""How far runs of every mode get, and whose fault it is when that is less."""

import pytest
from msgspec.structs import replace

from groundlink.core.clock import TICK_RATE_HZ
from groundlink.core.errors import RunFailed
from groundlink.messages.base import Ack
from groundlink.scenario.route import DRIVER_WINDOW_TICKS, Square
from groundlink.scenario.schema import Time
from services.physics.run.pacer import SKIP_AT_ONCE_SECONDS, SLOW_AT_ONCE_SECONDS, pacer_for
from tests.services.physics.paced import EPISODE, LAB, LIDAR, SENSORS, Paced

HALF = {LIDAR: 0.5}


@pytest.mark.parametrize("overload", ["slow", "skip", "fail"])
@pytest.mark.parametrize("factor", [0.5, 1.0, 3.0])
def test_real_time_keeps_to_the_wall(overload: str, factor: float) -> None:
    run = Paced.joined(Time(overload=overload, factor=factor))  # type: ignore[arg-type]
    run.run(10.0)
    assert run.sim_seconds == pytest.approx(10.0 * factor, abs=0.01 * factor)
    assert run.stretched == {}
    assert run.lines == []


def test_slow_waits_for_a_late_sensor_and_names_it() -> None:
    run = Paced.joined(Time())
    run.run(20.0, times_real=HALF)
    window_seconds = run.time.window_ticks / TICK_RATE_HZ
    assert run.sim_seconds == pytest.approx(10.0 + window_seconds, abs=0.2)
    assert run.lag_ticks(LIDAR) <= run.time.window_ticks
    lost = 20.0 - run.sim_seconds
    assert sum(run.stretched.values()) == pytest.approx(lost, abs=SLOW_AT_ONCE_SECONDS)
    assert run.stretched[LIDAR] > 0.95 * sum(run.stretched.values())
    [line] = run.lines
    assert line.startswith("the run is 5.0 s behind"), "the sensor is slow, not silent"


def test_skip_never_waits() -> None:
    run = Paced.joined(Time(overload="skip"))
    run.run(10.0, times_real=HALF)
    assert run.sim_seconds == pytest.approx(10.0, abs=0.01)
    assert run.lag_ticks(LIDAR) > run.time.window_ticks


@pytest.mark.parametrize(
    ("overload", "pause", "stretched"),
    [
        ("skip", 0.9 * SKIP_AT_ONCE_SECONDS, 0.0),
        ("skip", SKIP_AT_ONCE_SECONDS + 0.3, 0.3),
        ("slow", 0.9 * SLOW_AT_ONCE_SECONDS, 0.0),
        ("slow", SLOW_AT_ONCE_SECONDS + 0.3, 0.3),
    ],
)
def test_physics_catches_up_after_not_being_scheduled(
    overload: str, pause: float, stretched: float
) -> None:
    run = Paced.joined(Time(overload=overload, catch_up=0.0))  # type: ignore[arg-type]
    run.run(1.0)
    run.run(9.0, pause=pause)
    assert run.sim_seconds == pytest.approx(10.0 - stretched, abs=0.02)
    assert run.stretched == ({"physics": pytest.approx(stretched, abs=0.01)} if stretched else {})


@pytest.mark.parametrize(("overload", "at_once"), [("slow", 0.2), ("skip", 3.0), ("fail", 0.2)])
@pytest.mark.parametrize("factor", [0.5, 1.0])
def test_stamps_are_back_at_the_wall_clock_ten_seconds_after_a_stall(
    overload: str, at_once: float, factor: float
) -> None:
    run = Paced.joined(Time(overload=overload, factor=factor))  # type: ignore[arg-type]
    run.run(1.0)
    run.run(at_once + 0.7, pause=at_once + 0.4)  # with time to step what is made up for at once
    behind = run.pacer.behind_seconds(run.tick)
    assert 0.1 < behind < 0.4
    assert f"{behind:.1f} s still to catch up" in str(run.stall_policy.stalls(run.pacer))
    begin = run.sim_seconds
    run.run(2.0)
    assert (run.sim_seconds - begin) / factor == pytest.approx(2.0 * 1.05, abs=0.01)
    run.run(7.3)
    assert run.sim_seconds == pytest.approx((11.0 + at_once) * factor, abs=0.01)
    assert run.pacer.behind_seconds(run.tick) == 0.0
    assert "catch up" not in str(run.stall_policy.stalls(run.pacer))
    assert run.lines == []


def test_without_catching_up_a_run_stays_behind_and_owes_nothing() -> None:
    run = Paced.joined(Time(catch_up=0.0))
    run.run(10.0, pause=1.0)
    assert run.sim_seconds == pytest.approx(9.2, abs=0.01)
    assert run.pacer.behind_seconds(run.tick) == 0.0
    assert run.lines == []


def test_slow_writes_off_delay_beyond_the_deadline_once() -> None:
    run = Paced.joined(Time(deadline_s=5.0))
    run.run(10.0, pause=6.0)
    run.run(10.0, pause=6.0)
    assert run.sim_seconds == pytest.approx(20.0 - 2 * 5.8, abs=0.02)
    assert run.lines == [
        "the run is 5.8 s behind, more than `deadline_s`, and does not catch up: stamps "
        "stay behind the wall clock. `groundlink reset` starts a new episode"
    ]


def test_skip_catches_up_however_long_it_takes() -> None:
    run = Paced.joined(Time(overload="skip", deadline_s=5.0))
    run.run(13.0, pause=13.0)
    run.run(220.0)
    assert run.sim_seconds == pytest.approx(233.0, abs=0.01)
    assert run.lines == []


def test_fail_tolerates_delay_that_is_caught_up() -> None:
    run = Paced.joined(Time(overload="fail", deadline_s=0.5))
    for _ in range(10):
        run.run(10.0, pause=0.5)
    assert sum(run.stretched.values()) == pytest.approx(3.0, abs=0.1)
    with pytest.raises(RunFailed, match=r"time has stretched by 3\.6 s"):
        run.run(1.0, pause=0.8)


def test_realtime_ignores_absent_and_optional_processes() -> None:
    pacer = pacer_for(LAB, EPISODE, ["rover/driver"])
    pacer.participants.acknowledged("gateway", Ack(EPISODE, 3, 3))
    pacer.participants.acknowledged("rover/driver", Ack(EPISODE, 3, 3))
    assert pacer.participants.missing(10**6) == []
    for name in (*SENSORS, "recorder"):
        pacer.participants.acknowledged(name, Ack(EPISODE, 3, 3))
    assert pacer.participants.missing(10**6) == sorted([*SENSORS, "recorder"])


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_lockstep_keeps_to_the_wall_while_all_follow(factor: float) -> None:
    run = Paced.joined(Time(mode="lockstep", factor=factor))
    run.run(10.0)
    assert run.sim_seconds == pytest.approx(10.0 * factor, abs=0.05)
    run.run(10.0, times_real={LIDAR: 0.4 * factor})
    assert run.sim_seconds == pytest.approx(14.0 * factor, abs=1.2)
    assert run.stretched[LIDAR] > 4.0


def test_fast_goes_as_fast_as_the_slowest() -> None:
    run = Paced.joined(Time(mode="fast"), required=["recorder"])
    run.run(5.0, times_real={LIDAR: 6.0, "recorder": 40.0})
    assert run.sim_seconds == pytest.approx(30.0, abs=1.1)
    assert run.lag_ticks("recorder") <= run.lag_ticks(LIDAR) <= run.time.window_ticks
    assert run.stretched == {}


@pytest.mark.parametrize("mode", ["fast", "lockstep"])
def test_lockstep_begins_with_all_that_it_waits_for(mode: str) -> None:
    driven = replace(LAB, vehicles=(replace(LAB.vehicles[0], route=Square()),))
    scenario = replace(driven, time=Time(mode=mode))  # type: ignore[arg-type]
    pacer = pacer_for(scenario, EPISODE, ["recorder"])
    participants = sorted([*SENSORS, "recorder", "rover/driver"])
    assert pacer.participants.missing(0) == participants
    for name in participants:
        pacer.participants.acknowledged(name, Ack(EPISODE, 0, 0))
    assert pacer.participants.missing(DRIVER_WINDOW_TICKS + 1) == ["rover/driver"]
    assert pacer.participants.missing(401) == participants
    pacer.participants.acknowledged("gateway", Ack(EPISODE, 0, 0))
    assert "gateway" in pacer.participants.missing(401)
    pacer.participants.left("gateway")
    assert "gateway" not in pacer.participants.missing(401)


def test_lockstep_with_ros_steps_from_reply_to_reply() -> None:
    time = Time(mode="fast", lockstep="ros", clock_rate_hz=100.0)
    pacer = pacer_for(replace(LAB, time=time), EPISODE, [])
    for name in SENSORS:
        pacer.participants.acknowledged(name, Ack(EPISODE, 400, 400))
    assert pacer.participants.missing(0) == []
    assert pacer.participants.missing(1) == ["gateway"]
    pacer.participants.acknowledged("gateway", Ack(EPISODE, 0, 0))
    assert pacer.participants.missing(4) == []
    assert pacer.participants.missing(5) == ["gateway"]
    pacer.participants.left("gateway")
    assert pacer.participants.missing(5) == ["gateway"], "it is needed"


def test_pause_is_no_delay() -> None:
    run = Paced.joined(Time())
    run.run(5.0, times_real={LIDAR: 0.0})
    before = run.sim_seconds, dict(run.stretched)
    run.now += 100.0
    run.pacer.restart()
    run.stall_policy.pause()
    run.run(1.0)
    assert run.sim_seconds == pytest.approx(before[0] + 1.0, abs=0.02)
    assert sum(run.stretched.values()) == pytest.approx(sum(before[1].values()), abs=0.01)


def test_two_processes_that_stall_a_step_share_its_cost() -> None:
    run = Paced.joined(Time())
    stopped = {LIDAR: 0.0, "rover/imu": 0.0}
    run.run(4.0, times_real=stopped)
    assert run.stretched[LIDAR] == pytest.approx(run.stretched["rover/imu"])
    assert sum(run.stretched.values()) == pytest.approx(3.0, abs=0.25)
