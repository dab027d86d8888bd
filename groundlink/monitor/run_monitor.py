# SPDX-License-Identifier: Apache-2.0
"""Run monitor: health of processes, streams on the ROS side, real-time factor.

Health messages and wall time are arguments. The dashboard and the report compute nothing
themselves.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

from groundlink.bus.core_topics import PHYSICS, TIME_KEEPERS
from groundlink.core.clock import TICK_SECONDS
from groundlink.messages.base import Health, StreamReport
from groundlink.messages.stalls import Stalls

from .stream_totals import StreamTotals

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
