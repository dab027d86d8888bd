# SPDX-License-Identifier: Apache-2.0
"""Counters of processes, ages of streams and faults of sensors, from the diagnostics of a run.

Of counters the last value is kept; of ages every sample, thinned in long runs.
"""

from dataclasses import dataclass, field
from typing import Any

from groundlink.episode.fault_messages import Faults
from groundlink.messages.base import StreamReport
from groundlink.scenario.faults import Fault

PROCESS_FIELDS = ("pid", "host", "tick")
"""Fields of a process's status that are no counters."""

MAX_AGES = 5_000
"""Maximum samples of a stream; beyond, every second sample is dropped."""


@dataclass
class StreamHistory:
    """History of one stream between the gateway and the ROS side."""

    last: dict[str, str]
    """The fields of the newest `StreamReport`, as text."""

    ages: list[tuple[float, float, float]] = field(default_factory=list)
    """Time (s of the run), median age (s), what 99 % do not exceed (s)."""


class RunDiagnostics:
    """Diagnostics of all processes and streams of a run."""

    def __init__(self) -> None:
        self.processes: dict[str, dict[str, str]] = {}
        """Last status of each process: host, pid and counters, as text."""

        self.streams: dict[tuple[str, str], StreamHistory] = {}
        """By topic and direction."""

        self._stride = 1
        self._heard = 0

    def add(self, seconds: float, array: Any) -> None:
        """Take a diagnostic_msgs/DiagnosticArray of the recorder."""
        self._heard += 1
        keeps = self._heard % self._stride == 0
        for status in array.status:
            facts = {pair.key: pair.value for pair in status.values}
            if "pid" in facts:
                self.processes[status.name] = facts
            elif {"topic", "direction", "sent"} <= facts.keys():
                self._heard_stream(seconds, facts, keeps=keeps)

    def _heard_stream(self, seconds: float, facts: dict[str, str], *, keeps: bool) -> None:
        key = facts["topic"], facts["direction"]
        words = self.streams.setdefault(key, StreamHistory(facts))
        words.last = facts
        ages = facts.get("age_seconds", ""), facts.get("age_p99_seconds", "")
        if keeps and all(ages):
            words.ages.append((seconds, float(ages[0]), float(ages[1])))
        if len(words.ages) > MAX_AGES:
            self._stride *= 2
            for stream in self.streams.values():
                stream.ages = stream.ages[::2]


CAUSES = ("missing", "incomplete", "late", "dropped", "superseded")
"""Fields of `StreamReport` with causes of loss."""

assert set(CAUSES) <= set(StreamReport.__struct_fields__)


@dataclass
class FaultPeriod:
    """One fault."""

    fault: Fault
    begin_seconds: float
    end_seconds: float | None = None


class SensorFaultHistory:
    """Fault periods of one sensor, as its process reported them, in order of begin."""

    def __init__(self, sensor: str) -> None:
        self.sensor = sensor
        self.all: list[FaultPeriod] = []
        self._open: list[FaultPeriod] = []

    def add(self, seconds: float, report: Faults) -> None:
        """Add the faults reported at an instant."""
        for failure in self._open:
            if failure.fault not in report.active:
                failure.end_seconds = seconds
        known = [failure.fault for failure in self._open]
        self._open = [failure for failure in self._open if failure.end_seconds is None]
        begun = [FaultPeriod(fault, seconds) for fault in report.active if fault not in known]
        self._open += begun
        self.all += begun
