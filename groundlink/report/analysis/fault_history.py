# SPDX-License-Identifier: Apache-2.0
"""Fault history of a sensor: the begin and end of each fault, as its process reported them."""

from dataclasses import dataclass

from groundlink.episode.fault_messages import Faults
from groundlink.scenario.faults import Fault


@dataclass
class FaultPeriod:
    """One fault."""

    fault: Fault
    begin_seconds: float
    end_seconds: float | None = None


class SensorFaultHistory:
    """Fault periods of one sensor, in order of begin."""

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
