# SPDX-License-Identifier: Apache-2.0
"""The panel says what the table of `groundlink up` says."""

from typing import Any

from groundlink.messages.base import Health, StreamReport
from groundlink.monitor.run_monitor import RunMonitor
from services.view import link_panel
from services.view.plots import Plots

from .scenes import Remembering


def report(topic: str, measured_hz: float | None, **more: Any) -> StreamReport:
    fields: dict[str, Any] = {"age_seconds": 0.0015, "messages": 10, "lost": 0} | more
    return StreamReport(topic, "Imu", 400.0, measured_hz, **fields)


def heard(*streams: StreamReport) -> RunMonitor:
    monitor = RunMonitor()
    monitor.update(Health("physics", 1, 400, {}), 1.0)
    monitor.update(Health("gateway", 2, 400, {}, streams), 1.0)
    monitor.update(Health("physics", 1, 1200, {}), 3.0)
    return monitor


def test_a_kept_rate_reads_so() -> None:
    said = link_panel.text("lab", heard(report("/imu", 400.0, lost=3)), shown="")
    assert "Every declared rate is kept." in said
    assert "| /imu | 400 Hz | 400 Hz | 1.5 ms |  | 3 |" in said
    assert "1.00 x real time" in said
    assert "2 processes: gateway, physics" in said


def test_a_rate_that_is_not_kept_stands_out() -> None:
    said = link_panel.text("lab", heard(report("/imu", 300.0)), shown="")
    assert "**Not kept:** /imu: declared 400 Hz, measured 300.00 Hz" in said
    assert "| **/imu** |" in said


def test_before_the_gateway_has_spoken_nothing_is_claimed() -> None:
    said = link_panel.text("lab", RunMonitor(), shown="")
    assert "No delivery report from ROS yet" in said


def test_a_topic_has_a_line_in_each_direction() -> None:
    recording = Remembering()
    plots = Plots(recording)  # type: ignore[arg-type]
    both = (report("/odom", 50.0), report("/odom", 50.0, direction="from ROS", age_seconds=None))
    link_panel.plot(plots, 10**9, Health("gateway", 1, 1, {}, both))
    plots.flush()
    assert set(recording.columns) == {
        *("link/age/odom", "link/rate/odom", "link/rate/odom_from_ROS"),
        *("link/lost/odom", "link/lost/odom_from_ROS"),
    }
