# SPDX-License-Identifier: Apache-2.0
"""Run monitor: health of processes, streams on the ROS side, real-time factor.

Health messages and wall time are arguments. The dashboard and the report compute nothing
themselves.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

from msgspec.structs import replace

from groundlink.bus.core_topics import PHYSICS, TIME_KEEPERS
from groundlink.core.clock import TICK_SECONDS
from groundlink.messages.base import Health, StreamReport
from groundlink.messages.stalls import Stalls

RATE_TOLERANCE = 0.02
"""Allowed relative difference of the measured rate, by stamps, from the declared rate."""


def keeps_rate(stream: StreamReport) -> bool:
    """Return whether a stream kept its declared rate, if it has one.

    Without reports of the ROS side, a stream that was sent passes.
    """
    if stream.declared_hz is None:
        return True
    if not stream.reported:
        return stream.sent > 0
    if stream.measured_hz is None:
        return False
    return abs(stream.measured_hz / stream.declared_hz - 1) <= RATE_TOLERANCE


SUMMED = (
    *("messages", "lost", "sent", "missing", "incomplete", "late", "dropped", "in_flight"),
    *("repaired", "superseded", "delivered_bytes"),
)
"""Fields of `StreamReport` that count from the start of the gateway."""

_Key = tuple[str, str, str]


class StreamTotals:
    """Sums the reports of a gateway and its predecessors.

    A gateway counts from its start, so its counts drop at a restart. The last report of each
    earlier gateway is added.
    """

    def __init__(self) -> None:
        self._process: tuple[str, int] | None = None
        self._last: dict[_Key, StreamReport] = {}
        self._before: dict[_Key, StreamReport] = {}

    def of(self, health: Health) -> Sequence[StreamReport]:
        """Return the streams of a gateway's health message with summed counts."""
        process = health.host, health.pid
        is_new = self._process not in (None, process)
        self._process = process
        rows = {_key(row): row for row in health.streams}
        for key, last in self._last.items():
            # A gateway restarts its counts in the same process when vehicles or its peer change.
            if is_new or (key in rows and rows[key].sent < last.sent):
                self._before[key] = _sum(last, self._before.get(key))
        self._last = rows
        return [_sum(row, self._before.get(_key(row))) for row in health.streams]


def _key(row: StreamReport) -> _Key:
    return row.direction, row.type, row.topic


def _sum(row: StreamReport, before: StreamReport | None) -> StreamReport:
    """Return a report with summed counts, the rate over both, and the ages of the newer one."""
    if before is None:
        return row
    reported = row.reported or before.reported
    counts = {field: getattr(row, field) + getattr(before, field) for field in SUMMED}
    return replace(row, **counts, measured_hz=_rate_hz(row, before), reported=reported)


def _rate_hz(*rows: StreamReport) -> float | None:
    """Return the mean rate over the measured periods."""
    measured = [(row.messages - 1, row.measured_hz) for row in rows if row.measured_hz]
    seconds = sum(periods / rate_hz for periods, rate_hz in measured)
    return sum(periods for periods, _ in measured) / seconds if seconds > 0 else None


@dataclass
class RunMonitor:
    """The latest health of every process, with derived results."""

    health: dict[str, Health] = field(default_factory=dict)
    streams: Sequence[StreamReport] = ()
    """Report of each stream, summed over restarts of the gateway."""

    first_tick: int | None = None
    tick: int = 0
    _totals: StreamTotals = field(default_factory=StreamTotals)
    _first_seconds: float = 0.0
    _last_seconds: float = 0.0

    def update(self, health: Health, now_seconds: float) -> None:
        """Process a health message that arrived at wall time `now_seconds`."""
        self.health[health.process] = health
        if health.streams:
            self.streams = self._totals.of(health)
        if health.process in TIME_KEEPERS:
            # Start measuring when ticks advance: at the first tick physics waits for other
            # processes.
            is_waiting = health.tick == self.first_tick or self.tick < 0
            if self.first_tick is None or health.tick < self.tick or is_waiting:
                self.first_tick, self._first_seconds = health.tick, now_seconds
            self.tick, self._last_seconds = health.tick, now_seconds

    def counters_of(self, process: str, pid: int | None) -> dict[str, dict[str, int]]:
        """Return the counters of a process by name; of a shared process, those of each sensor."""
        found = (
            health for name, health in self.health.items() if process == name or pid == health.pid
        )
        return {health.process: health.counters for health in found} or {process: {}}

    @property
    def sim_seconds(self) -> float:
        """Sim time since physics started."""
        return self.tick * TICK_SECONDS

    @property
    def real_time_factor(self) -> float | None:
        """Sim seconds for each wall second, over all health messages of physics."""
        wall = self._last_seconds - self._first_seconds
        if self.first_tick is None or wall <= 0:
            return None
        return (self.tick - self.first_tick) * TICK_SECONDS / wall

    @property
    def stalls(self) -> Stalls:
        """Stalls that physics has reported."""
        physics = self.health.get(PHYSICS)
        return Stalls.read(physics.counters if physics else {})

    @property
    def is_reported(self) -> bool:
        """Whether the ROS side has ever sent a report."""
        return any(s.reported for s in self.streams if s.direction == "to ROS")

    def everything_is_sent(self) -> bool:
        """Return whether every declared stream was sent to the ROS side."""
        return self._has_declared and not self.not_sent()

    def not_sent(self) -> list[str]:
        """Return the topics of declared streams that were never sent to the ROS side."""
        return [s.topic for s in self.streams if s.declared_hz is not None and not s.sent]

    def not_arrived(self) -> list[str]:
        """Return the topics of declared streams that never arrived on the ROS side."""
        return [s.topic for s in self.streams if s.declared_hz is not None and not s.messages]

    def everything_arrives(self) -> bool:
        """Return whether every declared stream has arrived on the ROS side."""
        return self._has_declared and not self.not_arrived()

    @property
    def _has_declared(self) -> bool:
        return any(s.declared_hz is not None for s in self.streams)

    def faults(self, *, needs_reports: bool = True) -> list[str]:
        """Return the problems of the run as lines; none if every declared rate was kept.

        Parameters
        ----------
        needs_reports
            whether missing reports of the ROS side are a problem.
        """
        if not self.streams or (needs_reports and not self.is_reported):
            return ["no report from the ROS side"]
        lines = []
        for stream in self.streams:
            if not keeps_rate(stream):
                measured = "none" if stream.measured_hz is None else f"{stream.measured_hz:.2f} Hz"
                declared = f"{stream.declared_hz:g} Hz"
                lines.append(f"{stream.topic}: declared {declared}, measured {measured}")
        return lines
