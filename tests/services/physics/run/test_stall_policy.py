# SPDX-License-Identifier: Apache-2.0
"""Who lets a run wait is named in time, once, and what the scenario has for it happens."""

from typing import Any

import pytest

from groundlink.bus.core_topics import GATEWAY
from groundlink.core.errors import RunFailed
from groundlink.messages.missing_readings import MissingReadings, MissingSpan
from groundlink.messages.stalls import Stalls
from groundlink.scenario.schema import Time
from services.physics.run.stall_policy import START_SECONDS
from tests.services.physics.paced import LIDAR, SENSORS, Paced

DEADLINE = 2.0
STOPPED = {LIDAR: 0.0}
SLACK = 1.1
"""A window of 400 ticks, after which a silence is felt in real time, and a little."""


def begun(**time: Any) -> Paced:
    run = Paced.joined(Time(deadline_s=DEADLINE, **time))
    run.run(1.0)
    return run


def stalls(run: Paced) -> Stalls:
    return run.stall_policy.stalls(run.pacer)


@pytest.mark.parametrize("time", [{}, {"mode": "lockstep"}, {"mode": "fast"}])
def test_no_process_is_named_before_the_deadline(time: dict[str, str]) -> None:
    run = begun(**time)
    run.run(0.95 * DEADLINE, times_real=STOPPED)
    run.run(1.0)
    run.run(0.95 * DEADLINE, times_real=STOPPED)
    assert run.lines == []
    assert stalls(run).silent_now == ()


def test_a_silent_sensor_is_absent_in_real_time_until_it_is_back() -> None:
    run = begun()
    run.run(DEADLINE + SLACK, times_real=STOPPED)
    [named, gone] = run.lines
    assert named.startswith("tick ")
    assert named.endswith(f"has waited 2 s for {LIDAR}")
    assert gone == f"continuing without {LIDAR} until it responds"
    assert stalls(run).silent_now == (LIDAR,)
    sim = run.sim_seconds
    run.run(10.0, times_real=STOPPED)
    assert run.sim_seconds == pytest.approx(sim + 10.0 * 1.05, abs=0.03), "it catches up"
    assert len(run.lines) == 2, "it is said once"
    run.run(1.0)
    assert len(run.lines) == 3
    assert run.lines[-1].startswith(f"{LIDAR} is responding again after 12.")
    told = stalls(run)
    assert told.silent_now == ()
    assert told.silent_seconds[LIDAR] == pytest.approx(12.1, abs=0.2)
    assert told.stretched_seconds[LIDAR] == pytest.approx(DEADLINE, abs=0.25)
    run.run(DEADLINE + SLACK, times_real=STOPPED)
    assert sum("has waited 2 s" in line for line in run.lines) == 2, "the next one is named again"


@pytest.mark.parametrize("mode", ["lockstep", "fast"])
def test_slow_lockstep_names_a_silent_participant_and_waits_on(mode: str) -> None:
    run = begun(mode=mode)
    run.run(20.0, times_real=STOPPED)
    assert len(run.lines) == 1
    assert run.lag_ticks(LIDAR) <= run.time.window_ticks
    run.run(1.0)
    assert len(run.lines) == 2
    assert "is responding again after" in run.lines[1]


@pytest.mark.parametrize("mode", ["lockstep", "fast"])
def test_skip_in_lockstep_goes_on_after_the_deadline(mode: str) -> None:
    run = begun(mode=mode, overload="skip")
    run.run(DEADLINE + SLACK, times_real=STOPPED)
    assert "continuing without" in run.lines[-1]
    assert run.lag_ticks(LIDAR) > 0
    sim = run.sim_seconds
    run.run(3.0, times_real=STOPPED)
    assert run.sim_seconds > sim + 2.9
    assert len(run.lines) == 2


def test_a_gateway_that_skips_ros_is_back_though_ros_may_not_be() -> None:
    for overload, back in (
        ("slow", "gateway (waits for ROS) is responding again after "),
        ("skip", "gateway (waits for ROS) is responding again after "),
    ):
        time = Time("fast", "ros", overload=overload, deadline_s=DEADLINE)  # type: ignore[arg-type]
        run = Paced.joined(time, required=[GATEWAY])
        run.run(1.0)
        run.run(DEADLINE + SLACK, times_real={GATEWAY: 0.0})
        run.run(1.0)
        assert run.lines[-1].startswith(back)


@pytest.mark.parametrize("time", [{}, {"mode": "lockstep"}, {"mode": "fast"}])
def test_fail_ends_the_run_at_the_deadline(time: dict[str, str]) -> None:
    run = begun(overload="fail", **time)
    begin = run.now
    with pytest.raises(RunFailed, match=f"has waited 2 s for {LIDAR}; run aborted by"):
        run.run(30.0, times_real=STOPPED)
    assert DEADLINE <= run.now - begin < DEADLINE + SLACK
    assert stalls(run).silent_now == (LIDAR,), "the last report says who it was"


def test_fail_ends_a_run_in_real_time_that_has_stretched_beyond_the_deadline() -> None:
    run = begun(overload="fail")
    with pytest.raises(RunFailed) as failed:
        run.run(30.0, times_real={LIDAR: 0.5})
    said = str(failed.value)
    assert said.startswith("time has stretched by 2.")
    assert LIDAR in said
    assert stalls(run).silent_now == (), "it is slow, not silent"


def test_fail_in_lockstep_bears_time_that_stretches() -> None:
    run = begun(mode="lockstep", overload="fail")
    run.run(10.0, times_real={LIDAR: 0.5})
    assert sum(run.stretched.values()) > DEADLINE
    assert run.lines == []


@pytest.mark.parametrize(
    ("cause", "ends"),
    [("overloaded", True), ("states lost", True), ("restarted", True)]
    + [(cause, False) for cause in ("not there", "world changed", "removed", "drop", "off")],
)
def test_fail_ends_a_run_that_lacks_readings_which_it_was_to_have(cause: Any, ends: bool) -> None:
    told = MissingReadings(
        9, LIDAR, (MissingSpan(cause, 1, 5, 3, ("",)), MissingSpan(cause, 7, 8, 2, ("",)))
    )
    for overload in ("slow", "skip"):
        begun(overload=overload).stall_policy.missing_readings(told)
    run = begun(overload="fail")
    if not ends:
        run.stall_policy.missing_readings(told)
        return
    with pytest.raises(
        RunFailed, match=f"{LIDAR}: missing readings: 5 {cause}; run aborted by `overload: fail`"
    ):
        run.stall_policy.missing_readings(told)


@pytest.mark.parametrize("overload", ["slow", "skip", "fail"])
def test_starting_process_has_a_longer_deadline(overload: Any) -> None:
    run = Paced(Time(mode="fast", overload=overload, deadline_s=DEADLINE))
    check, pacer, begin = run.stall_policy.check, run.pacer, 100.0

    def looked(after: float) -> list[str]:
        missing = pacer.participants.missing(0)
        return check(pacer, 0, begin + after, holding=missing, awaited=("recorder",))

    assert looked(0.0) == []
    participants = ", ".join(sorted(["recorder", *SENSORS]))
    assert looked(DEADLINE) == [f"tick 0 has waited 2 s for {participants}"]
    assert looked(START_SECONDS - 1) == []
    if overload == "fail":
        with pytest.raises(RunFailed, match=r"rover/camera, rover/encoders.*run aborted by"):
            looked(START_SECONDS)
    elif overload == "skip":
        [line] = looked(START_SECONDS)
        assert line == f"continuing without {', '.join(sorted(SENSORS))} until it responds"
        assert pacer.participants.missing(0) == []
    else:
        assert looked(10 * START_SECONDS) == []


def test_a_process_has_a_minute_to_start() -> None:
    """Imports and shaders take long on a busy machine; who waits in vain for longer loses time."""
    assert START_SECONDS == 60.0


def test_a_silence_of_several_is_one_line() -> None:
    run = begun()
    run.run(DEADLINE + SLACK, times_real=dict.fromkeys(SENSORS, 0.0))
    assert [line for line in run.lines if ", ".join(sorted(SENSORS)) in line] == run.lines
    assert len(run.lines) == 2


def test_missing_ros_reply_is_named() -> None:
    run = Paced.joined(Time(mode="fast", lockstep="ros", deadline_s=DEADLINE))
    run.run(DEADLINE + 0.1)
    assert run.lines == ["tick 1 has waited 2 s for gateway (waits for ROS)"]


def test_departed_process_is_not_reported_as_back() -> None:
    run = begun()
    run.run(DEADLINE + SLACK, times_real=STOPPED)
    run.pacer.participants.left(LIDAR)
    run.run(0.01, times_real=STOPPED)
    assert run.lines[-1].startswith(f"stopped waiting for {LIDAR} after 2.")
    assert stalls(run).silent_now == ()


def test_a_run_that_begins_again_has_no_silence_yet() -> None:
    run = begun()
    run.run(DEADLINE + SLACK, times_real=STOPPED)
    run.stall_policy.reset()
    told = stalls(run)
    assert told.silent_now == ()
    assert told.silent_seconds[LIDAR] >= DEADLINE
