# SPDX-License-Identifier: Apache-2.0
"""Completeness of the sensor streams in a recording: due, published and missing readings.

The schedule comes from the scenario, the messages from the file, and the causes from the sensors,
so readings missing without a report are found. A reading in the file counts as published, whatever
was reported. Memory grows by one byte a reading.
"""

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from groundlink.bus.topics import sensor_outputs
from groundlink.core.clock import TICK_NANOS
from groundlink.messages.missing_readings import CAUSES, MissingReadings
from groundlink.scenario import Scenario
from groundlink.scenario.every_sensor import SensorSpec

IN_TRANSIT = "in transit"
"""Too near to the end of the recording for a report to be in the file."""

RECORDER_BEHIND = "recorder behind"
"""Dropped by the recorder."""

UNEXPLAINED = "unexplained"
"""No cause was reported: the process had ended, or there is a bug."""

_KNOWN = ("", "published", *CAUSES)
_PUBLISHED = _KNOWN.index("published")


@dataclass(frozen=True)
class MissingInterval:
    """Consecutive readings missing for one cause."""

    cause: str
    first_nanos: int
    last_nanos: int
    readings: int


class StreamCompleteness:
    """Completeness of one stream.

    Parameters
    ----------
    first_nanos, last_nanos, reported_nanos
        Sim times of the recording: first and last message, and the instant up to which all reports
        of sensors are in it.
    """

    def __init__(
        self,
        sensor: str,
        output: str,
        topic: str,
        spec: SensorSpec,
        *,
        first_nanos: int,
        last_nanos: int,
        reported_nanos: int,
    ) -> None:
        self.sensor, self.output, self.topic = sensor, output, topic
        self._calendar = spec.schedule()
        self._first = max(self._calendar.at_or_after(first_nanos), self._calendar.first)
        end = max(self._calendar.at_or_after(last_nanos + 1), self._first)
        self._reported = self._calendar.at_or_after(reported_nanos)
        self._found: NDArray[np.uint8] = np.zeros(end - self._first, np.uint8)
        """State of each reading, as an index into `_KNOWN`."""

        self._dropped = 0

    @property
    def due(self) -> int:
        """How many readings were due."""
        return len(self._found)

    @property
    def published(self) -> int:
        """Number of readings in the file."""
        return int(np.count_nonzero(self._found == _PUBLISHED))

    def add(self, nanos: int) -> None:
        """Count a message of this instant."""
        reading = self._calendar.at_or_after(nanos) - self._first
        if 0 <= reading < len(self._found):
            self._found[reading] = _PUBLISHED

    def add_report(self, report: MissingReadings, epoch_nanos: int) -> None:
        """Add the missing readings that the sensor reported."""
        for gap in report.gaps:
            if self.output in gap.outputs:
                first, last = (
                    self._calendar.at_or_after(nanos - epoch_nanos) - self._first
                    for nanos in (gap.first_nanos, gap.last_nanos)
                )
                part = self._found[max(first, 0) : max(last + 1, 0)]
                part[part == 0] = _KNOWN.index(gap.cause)

    def dropped(self, count: int) -> None:
        """Set the number of messages dropped by the recorder."""
        self._dropped = count

    def missing(self) -> Counter[str]:
        """Return the number of missing readings by cause."""
        counts: Counter[str] = Counter()
        for hole in self.holes():
            counts[hole.cause] += hole.readings
        return counts

    def holes(self) -> list[MissingInterval]:
        """Return all missing spans in order of time."""
        begins = np.flatnonzero(np.diff(self._found, prepend=self._found[:1] + 1))
        # Split at the instant up to which reports are complete.
        reported = self._reported - self._first
        begins = np.union1d(begins, [reported] if 0 < reported < self.due else [])
        ends = np.append(begins[1:], self.due)
        found, dropped = [], self._dropped
        for begin, end in zip(begins.astype(int).tolist(), ends.astype(int).tolist(), strict=True):
            cause = _KNOWN[self._found[begin]]
            if cause == "published":
                continue
            if not cause:
                if begin >= reported:
                    cause = IN_TRANSIT
                elif dropped >= end - begin:
                    cause, dropped = RECORDER_BEHIND, dropped - (end - begin)
                else:
                    cause = UNEXPLAINED
            first, last = (self._calendar.nanos(self._first + i) for i in (begin, end - 1))
            found.append(MissingInterval(cause, first, last, end - begin))
        return found


def stream_completeness(
    scenario: Scenario, *, first_nanos: int, last_nanos: int, epoch_nanos: int
) -> list[StreamCompleteness]:
    """Return the completeness of all sensor streams, for a recording of this span."""
    time = scenario.time
    # Sensors report with their progress, which may lag by a window.
    reported_nanos = last_nanos - (time.window_ticks + time.ack_ticks) * TICK_NANOS
    return [
        StreamCompleteness(
            *(f"{vehicle.name}/{sensor.name}", output.name, output.ros_topic, sensor),
            first_nanos=first_nanos - epoch_nanos,
            last_nanos=last_nanos - epoch_nanos,
            reported_nanos=reported_nanos - epoch_nanos,
        )
        for vehicle in scenario.vehicles
        for sensor in vehicle.sensors
        for output in sensor_outputs(sensor)
    ]
