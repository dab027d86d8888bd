# SPDX-License-Identifier: Apache-2.0

import pytest
from msgspec.structs import replace

from groundlink.messages.base import Health, StreamReport
from groundlink.monitor.run_monitor import RunMonitor, keeps_rate


def stream(declared: float | None, measured: float | None, messages: int = 10) -> StreamReport:
    return StreamReport("/t", "Imu", declared, measured, None, messages, 0)


@pytest.mark.parametrize(
    ("declared", "measured", "kept"),
    [
        (100.0, 100.0, True),
        (100.0, 98.1, True),
        (100.0, 101.9, True),
        (100.0, 97.9, False),
        (100.0, 102.1, False),
        (100.0, None, False),
        (None, 0.3, True),
        (None, None, True),
    ],
)
def test_a_rate_is_kept_within_two_percent(
    declared: float | None, measured: float | None, kept: bool
) -> None:
    assert keeps_rate(stream(declared, measured)) is kept


REPLAYED = [("replay", 1, tick, at) for tick, at in ((-1, 10), (-1, 15), (8000, 16), (8400, 17))]
WAITED = [("physics", 1, 0, 20.0), ("physics", 1, 0, 25.0), ("physics", 1, 400, 26.0)]
RESTARTED = [("physics", 1, 4000, 10.0), ("physics", 2, 0, 12.0), ("physics", 2, 400, 13.0)]


@pytest.mark.parametrize(
    ("heard", "factor", "sim_seconds"),
    [
        ([], None, 0.0),
        ([("physics", 1, 400, 10.0)], None, 1.0),
        ([("physics", 1, 400, 10.0), ("physics", 1, 1200, 14.0)], 0.5, 3.0),
        (REPLAYED, 1.0, 21.0),
        (REPLAYED + WAITED, 1.0, 1.0),
        (RESTARTED, 1.0, 1.0),
    ],
    ids=["none", "one", "two", "waiting replay", "waiting physics", "restart"],
)
def test_real_time_factor_is_sim_over_wall_while_ticks_advance(
    heard: list[tuple[str, int, int, float]], factor: float | None, sim_seconds: float
) -> None:
    monitor = RunMonitor()
    for process, pid, tick, seconds in heard:
        monitor.update(Health(process, pid, tick, {}), seconds)
    assert monitor.real_time_factor == (factor if factor is None else pytest.approx(factor))
    assert monitor.sim_seconds == pytest.approx(sim_seconds)


def test_faults_name_topic_and_rates() -> None:
    monitor = RunMonitor()
    assert monitor.faults() == ["no report from the ROS side"]
    monitor.update(Health("gateway", 1, 0, {}, (stream(100.0, 90.0), stream(5.0, None))), 1.0)
    assert monitor.faults() == [
        "/t: declared 100 Hz, measured 90.00 Hz",
        "/t: declared 5 Hz, measured none",
    ]
    monitor.update(Health("gateway", 1, 0, {}, (stream(100.0, 100.0),)), 2.0)
    assert monitor.faults() == []


def test_everything_arrives_when_each_declared_stream_has() -> None:
    monitor = RunMonitor()
    assert not monitor.everything_arrives()
    waiting = (stream(10.0, None, 0), stream(None, None, 0))
    monitor.update(Health("gateway", 1, 0, {}, waiting), 1.0)
    assert not monitor.everything_arrives()
    monitor.update(Health("gateway", 1, 0, {}, (stream(10.0, None, 1), waiting[1])), 2.0)
    assert monitor.everything_arrives()


UNKNOWN = StreamReport("/t", "Imu", 10.0, None, None, 0, 0, sent=7, in_flight=7, reported=False)
BACK = StreamReport("/cmd_vel", "Twist", None, 20.0, 0.001, 7, 0, direction="from ROS", sent=7)


def test_missing_reports_do_not_fail_runs_without_reports() -> None:
    monitor = RunMonitor()
    monitor.update(Health("gateway", 1, 0, {}, (UNKNOWN, BACK)), 1.0)
    assert not monitor.is_reported
    assert monitor.everything_is_sent()
    assert not monitor.everything_arrives()
    assert monitor.faults(needs_reports=False) == []
    assert monitor.faults() == ["no report from the ROS side"]
    silent = replace(UNKNOWN, topic="/silent", sent=0, in_flight=0)
    monitor.update(Health("gateway", 1, 0, {}, (UNKNOWN, silent)), 2.0)
    assert not monitor.everything_is_sent()
    lines = ["/silent: declared 10 Hz, measured none"]
    assert monitor.faults(needs_reports=False) == lines


def test_reports_to_an_earlier_gateway_are_kept() -> None:
    monitor = RunMonitor()
    for pid, row in ((1, replace(UNKNOWN, reported=True)), (2, UNKNOWN)):
        monitor.update(Health("gateway", pid, 0, {}, (row,)), 1.0)
    assert monitor.is_reported
    assert [row.sent for row in monitor.streams] == [14]


def test_sensors_of_one_process_are_separate() -> None:
    monitor = RunMonitor()
    for name, pid in (("physics", 1), ("rover/imu", 7), ("rover/lidar", 7)):
        monitor.update(Health(name, pid, 400, {"readings": len(name)}), 0.0)
    assert monitor.counters_of("physics", 1) == {"physics": {"readings": 7}}
    shared = {"rover/imu": {"readings": 9}, "rover/lidar": {"readings": 11}}
    assert monitor.counters_of("sensors", 7) == shared
    assert monitor.counters_of("rover/driver", None) == {"rover/driver": {}}


def report(sent: int, *, lost: int = 0, hz: float | None = 100.0) -> StreamReport:
    arrived = sent - lost
    counts = {"sent": sent, "missing": lost, "delivered_bytes": 10 * arrived}
    return StreamReport("/clock", "Clock", 100.0, hz, 0.001, arrived, lost, **counts)


def heard(*healths: tuple[int, StreamReport]) -> StreamReport:
    """Return the total after gateways of these process ids have reported."""
    monitor = RunMonitor()
    for second, (pid, row) in enumerate(healths):
        monitor.update(Health("gateway", pid, 400 * second, {}, (row,)), float(second))
    [total] = monitor.streams
    return total


def test_one_gateway_counts_for_itself() -> None:
    assert heard((7, report(100)), (7, report(200))) == report(200)


@pytest.mark.parametrize("second", [50, 500], ids=["fewer than before", "more than before"])
def test_counts_of_a_restarted_gateway_are_added_to_those_before(second: int) -> None:
    total = heard((7, report(100)), (7, report(300, lost=3)), (8, report(10)), (8, report(second)))
    assert (total.sent, total.messages, total.missing) == (300 + second, 297 + second, 3)
    assert total.delivered_bytes == 10 * total.messages
    assert total.age_seconds == 0.001


def test_three_episodes_add_up() -> None:
    assert heard((7, report(100)), (8, report(200, lost=5)), (9, report(50))).sent == 350


def test_counters_that_restart_in_the_same_process_begin_an_episode() -> None:
    total = heard((7, report(300)), (7, report(20)), (7, report(40)))
    assert (total.sent, total.messages, total.delivered_bytes) == (340, 340, 3400)


@pytest.mark.parametrize("before", [False, True])
@pytest.mark.parametrize("now", [False, True])
def test_messages_reported_in_one_episode_stay_reported(before: bool, now: bool) -> None:
    episodes = (replace(report(100), reported=told) for told in (before, now))
    assert heard(*enumerate(episodes)).reported is (before or now)


def test_the_rate_is_that_over_all_episodes() -> None:
    total = heard((7, report(101, hz=100.0)), (8, report(51, hz=50.0)))
    assert total.measured_hz == pytest.approx(150 / 2.0)
    assert heard((7, report(101)), (8, report(0, hz=None))).measured_hz == pytest.approx(100.0)
    assert heard((7, report(0, hz=None)), (8, report(0, hz=None))).measured_hz is None
