# SPDX-License-Identifier: Apache-2.0
"""Live status of a run: streams to and from the ROS side, and processes.

Shows a `RunMonitor` and the children of a supervisor.
"""

from collections.abc import Iterable, Sequence

from rich.console import Group, RenderableType
from rich.text import Text

from groundlink.cli.expectations.output import expectations_table
from groundlink.cli.terminal.tables import Column, FittingTable
from groundlink.episode.fault_messages import kinds_in
from groundlink.episode.mission import Mission
from groundlink.expectations.results import ExpectationResult
from groundlink.messages import missing_readings
from groundlink.messages.base import NOT_REPORTED, StreamReport
from groundlink.monitor.run_monitor import RunMonitor, keeps_rate
from groundlink.monitor.supervisor import Child


def dashboard(
    title: str,
    monitor: RunMonitor,
    children: Iterable[Child],
    missions: Sequence[Mission] = (),
    expectations: Sequence[ExpectationResult] = (),
) -> RenderableType:
    """Return the status of a run as tables."""
    factor = monitor.real_time_factor
    pace = "starting" if factor is None else f"real-time factor {factor:.3f}"
    head = Text(f"{title}   sim time {monitor.sim_seconds:.1f} s   {pace}", style="bold")
    if stalls := str(monitor.stalls):
        head.append(f"\n{stalls}", style="yellow")
    tables = [missions_table(missions)] if missions else []
    tables += [expectations_table(expectations)] if expectations else []
    tables += [streams_table(monitor.streams), _processes(monitor, children)]
    return Group(head, *tables)


_STREAMS = (
    Column("topic", "path"),
    Column("type", "text", omit_order=1),
    Column("declared", omit_order=2),
    *map(Column, ("measured", "age p50", "p99", "sent", "arrived", "repaired")),
    Column("lost", "words"),
)

_PROCESSES = (
    Column("name", "text"),
    Column("pid", omit_order=1),
    Column("restarts"),
    Column("missing readings", "words"),
    Column("counts", "words"),
)


_MISSIONS = (
    Column("vehicle", "text"),
    Column("state", "words"),
    *map(Column, ("route", "driven", "of commanded", "of turns")),
    Column("stuck", omit_order=1),
)


def missions_table(missions: Iterable[Mission]) -> FittingTable:
    """Return the table of vehicles: what they do, and how much of what is commanded."""
    table = FittingTable("missions", _MISSIONS)
    for mission in missions:
        table.add_row(
            mission.vehicle,
            mission.state,
            percent(mission.route_share),
            f"{mission.driven_m:.1f} m",
            percent(mission.speed_share),
            percent(mission.turn_share),
            f"{mission.stuck_seconds:.1f} s",
            style="red" if mission.ending else "yellow" if mission.problems() else "",
        )
    return table


def percent(share: float | None) -> str:
    """Return a share as text."""
    return "-" if share is None else f"{100 * share:.0f} %"


def streams_table(streams: Iterable[StreamReport]) -> FittingTable:
    """Return the table of streams between the gateway and the ROS side."""
    table = FittingTable("to and from the ROS side", _STREAMS)
    for stream in streams:
        good = keeps_rate(stream) and not stream.lost
        table.add_row(
            stream.topic if stream.direction == "to ROS" else f"{stream.topic} (back)",
            stream.type,
            _number(stream.declared_hz, "Hz"),
            _number(stream.measured_hz, "Hz", 2),
            _milliseconds(stream.age_seconds),
            _milliseconds(stream.age_p99_seconds),
            str(stream.sent),
            str(stream.messages) if stream.reported else NOT_REPORTED,
            str(stream.repaired) if stream.reported else "-",
            _losses(stream) if stream.reported else "-",
            style="" if good else "yellow",
        )
    return table


def _losses(stream: StreamReport) -> str:
    """Return lost messages by cause; 0 without losses."""
    causes = ("missing", "incomplete", "late", "dropped", "superseded")
    counts = [(getattr(stream, cause), cause) for cause in causes]
    return ", ".join(f"{count} {cause}" for count, cause in counts if count) or "0"


def _processes(monitor: RunMonitor, children: Iterable[Child]) -> FittingTable:
    table = FittingTable("processes", _PROCESSES, padding=1)
    for child in children:
        pid = str(child.pid or child.last_exit)
        for name, counters in monitor.counters_of(child.name, child.pid).items():
            faults = kinds_in(counters)
            missing, counts = missing_readings.parted(counters)
            shown = f"{name}: {', '.join(faults)}" if faults else name
            said = ", ".join(f"{what} {count}" for what, count in counts.items() if count)
            style = "yellow" if faults or missing else ""
            table.add_row(
                *(shown, pid, str(child.restarts), missing_readings.in_words(missing), said),
                style=style,
            )
    return table


def _milliseconds(seconds: float | None) -> str:
    return _number(None if seconds is None else 1e3 * seconds, "ms", 1)


def _number(value: float | None, unit: str, digits: int | None = None) -> str:
    if value is None:
        return "-"
    return f"{value:g} {unit}" if digits is None else f"{value:.{digits}f} {unit}"
