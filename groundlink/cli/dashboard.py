# SPDX-License-Identifier: Apache-2.0
"""A run as a live table: what arrives on the ROS side, and the processes behind it.

Rule: shows a `RunMonitor` and the supervisor's children; decides nothing.
"""

from __future__ import annotations

from collections.abc import Iterable

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from groundlink.messages import StreamReport
from groundlink.run_monitor import RunMonitor, keeps_rate
from groundlink.supervisor import Child


def dashboard(title: str, monitor: RunMonitor, children: Iterable[Child]) -> RenderableType:
    """Return the whole picture of a run."""
    factor = monitor.real_time_factor
    pace = "starting" if factor is None else f"real-time factor {factor:.3f}"
    head = Text(f"{title}   sim time {monitor.sim_seconds:.1f} s   {pace}", style="bold")
    return Group(head, _streams(monitor.streams), _processes(monitor, children))


def _streams(streams: Iterable[StreamReport]) -> Table:
    table = Table(title="arrives on the ROS side", title_justify="left", expand=False)
    table.add_column("topic", no_wrap=True)
    table.add_column("type", no_wrap=True)
    for column in ("declared", "measured", "age", "messages", "lost"):
        table.add_column(column, justify="right", no_wrap=True)
    for stream in streams:
        good = keeps_rate(stream) and not stream.lost
        table.add_row(
            stream.topic,
            stream.type,
            _number(stream.declared_hz, "Hz"),
            _number(stream.measured_hz, "Hz", 2),
            _number(None if stream.age_seconds is None else 1e3 * stream.age_seconds, "ms", 1),
            str(stream.messages),
            str(stream.lost),
            style="" if good else "yellow",
        )
    return table


def _processes(monitor: RunMonitor, children: Iterable[Child]) -> Table:
    table = Table(title="processes", title_justify="left", expand=False)
    table.add_column("name", no_wrap=True)
    for column in ("pid", "restarts"):
        table.add_column(column, justify="right")
    table.add_column("counts")
    for child in children:
        health = monitor.health.get(child.name)
        counters = health.counters if health else {}
        counts = ", ".join(f"{name} {count}" for name, count in counters.items() if count)
        pid = str(child.process.pid) if child.process else child.last_exit
        table.add_row(child.name, pid, str(child.restarts), counts)
    return table


def _number(value: float | None, unit: str, digits: int | None = None) -> str:
    if value is None:
        return "-"
    return f"{value:g} {unit}" if digits is None else f"{value:.{digits}f} {unit}"
