# SPDX-License-Identifier: Apache-2.0
import pytest

from groundlink.cli.run.up import Duration
from groundlink.messages.base import Health, StreamReport
from groundlink.monitor.run_monitor import RunMonitor

SECOND_TICKS = 400


def stream(sent: int, *, arrived: int = 0, reported: bool = False) -> StreamReport:
    return StreamReport("/t", "Imu", 10.0, None, None, arrived, 0, sent=sent, reported=reported)


def passed(duration: Duration, monitor: RunMonitor, rows: list[StreamReport]) -> int | None:
    """Return after how many seconds of sim time, with a row each, the duration was over."""
    for second, row in enumerate(rows):
        monitor.update(Health("physics", 1, second * SECOND_TICKS, {}), second)
        monitor.update(Health("gateway", 2, second * SECOND_TICKS, {}, (row,)), second)
        if duration.is_over():
            return second
    return None


SILENT = [stream(0)] * 2 + [stream(10)] * 10
ARRIVES = [stream(0)] * 2 + [stream(10)] * 2 + [stream(20, arrived=5, reported=True)] * 10


@pytest.mark.parametrize(
    ("rows", "needs_reports", "over"),
    [(SILENT, False, 5), (SILENT, True, None), (ARRIVES, False, 7), (ARRIVES, True, 7)],
)
def test_a_duration_counts_from_what_arrives_or_where_nobody_reports_from_what_is_sent(
    rows: list[StreamReport], needs_reports: bool, over: int | None
) -> None:
    monitor = RunMonitor()
    duration = Duration(monitor, 3.0, needs_reports=needs_reports)
    assert passed(duration, monitor, rows) == over


def test_awaited_streams_of_a_duration_are_printed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [0.0]
    monkeypatch.setattr("groundlink.cli.run.up.time.monotonic", lambda: clock[0])
    said: list[str] = []
    monitor = RunMonitor()
    duration = Duration(monitor, 3.0, say=said.append)
    monitor.update(Health("gateway", 2, 0, {}, (stream(9), stream(9, arrived=1))), 0.0)
    for clock[0] in (0.0, 3.0, 5.0, 10.0, 19.0):
        assert not duration.is_over()
    assert said == ["--duration: waiting for /t (at most 20 s)"]
    for clock[0] in (21.0, 22.0):
        duration.is_over()
    assert said[1:] == ["--duration: started without /t"]


def test_without_a_ros_side_a_duration_waits_for_what_is_not_sent(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = [0.0]
    monkeypatch.setattr("groundlink.cli.run.up.time.monotonic", lambda: clock[0])
    said: list[str] = []
    monitor = RunMonitor()
    duration = Duration(monitor, 3.0, needs_reports=False, say=said.append)
    clock[0] = 5.0
    assert not duration.is_over()
    assert said == ["--duration: waiting for the gateway (at most 20 s)"]
    monitor.update(Health("gateway", 2, 0, {}, (stream(9),)), 0.0)
    assert not duration.is_over()
    assert len(said) == 1
