# SPDX-License-Identifier: Apache-2.0
"""Reading ledger: whether each reading of a sensor was published or is missing, and why.

Every due reading is entered once and in order, for each stream. The ledger finds a gap when a later
reading is published or when the sensor has passed the gap's time. Models report only deliberate
omissions. Gaps published shortly before a link failure may be lost, so they are published again.
"""

from collections import Counter, deque
from collections.abc import Callable, Iterable
from typing import NamedTuple

import msgspec
from msgspec.structs import replace

from groundlink.core.clock import TICK_NANOS
from groundlink.messages.missing_readings import Cause, MissingReadings, MissingSpan
from groundlink.messages.reading_schedule import ReadingSchedule

from .model import LeftOut

AGAIN_NANOS = 30_000_000_000
"""Gaps published within this period are published again after a reconnect. A dead link is detected
after 10 s at the latest, and the link after it may fail at the same moment."""


class _Missing(NamedTuple):
    """Consecutive missing readings of one stream, with one cause."""

    first: int
    last: int
    cause: Cause


class ReadingLedger:
    """Record of the published and missing readings of one sensor.

    Parameters
    ----------
    sensor
        Name as vehicle/sensor.
    outputs
        Names of the sensor's streams.
    publish
        Publishes the missing readings.

    Attributes
    ----------
    missing : Counter
        Number of reported missing readings, by cause.
    """

    def __init__(
        self,
        sensor: str,
        calendar: ReadingSchedule,
        outputs: Iterable[str],
        publish: Callable[[MissingReadings], object],
    ) -> None:
        self._sensor = sensor
        self._calendar = calendar
        self._outputs = tuple(outputs)
        self._publish = publish
        self.missing: Counter[Cause] = Counter()
        self._reported: deque[MissingReadings] = deque()
        """Recently published gaps of this episode."""

        self._begin()

    def _begin(self) -> None:
        """Begin an episode. Its readings are due from tick 0 on, whenever the sensor joined."""
        self._reported.clear()
        self._next = dict.fromkeys(self._outputs, self._calendar.first)
        self._pending: dict[str, list[_Missing]] = {output: [] for output in self._outputs}
        self._cause: Cause = "not there"

    def because(self, cause: Cause) -> None:
        """Set the cause of the missing readings that are found from now on."""
        self._cause = cause

    def published(self, output: str, nanos: int) -> None:
        """Record the publication of a reading with this sim time as its stamp."""
        reading = self._calendar.at_or_after(nanos)
        self._beyond(output, reading)
        self._next[output] = max(self._next[output], reading + 1)

    def left_out(self, one: LeftOut) -> None:
        """Record a reading that the sensor left out."""
        reading = self._calendar.at_or_after(one.nanos)
        for output in self._outputs if one.output is None else (one.output,):
            self._beyond(output, reading)
            self._miss(output, reading + 1, one.cause)

    def report(
        self, settled_tick: int, *, stamp_nanos: int, epoch_nanos: int, again: bool = False
    ) -> None:
        """Publish the missing readings that were found since the last call, if any.

        Parameters
        ----------
        settled_tick
            All later readings will have a stamp at or after this tick.
        stamp_nanos
            Stamp of the last state.
        again
            Whether to repeat recently published gaps.
        """
        settled = self._calendar.at_or_after(settled_tick * TICK_NANOS)
        outputs_of: dict[_Missing, list[str]] = {}
        for output in self._outputs:
            self._beyond(output, settled)
            for missing in self._pending[output]:
                outputs_of.setdefault(missing, []).append(output)
            self._pending[output] = []
        gaps = []
        for missing, outputs in sorted(outputs_of.items()):
            first, last, cause = missing
            gap = MissingSpan(
                cause,
                epoch_nanos + self._calendar.nanos(first),
                epoch_nanos + self._calendar.nanos(last),
                last - first + 1,
                tuple(outputs),
            )
            gaps.append(gap)
            self.missing[cause] += gap.readings
        report = MissingReadings(stamp_nanos, self._sensor, tuple(gaps))
        while self._reported and stamp_nanos - self._reported[0].stamp_nanos > AGAIN_NANOS:
            self._reported.popleft()
        before = [gap for one in self._reported for gap in one.gaps] if again else []
        if gaps:
            self._reported.append(report)
        if before or gaps:
            self._publish(replace(report, gaps=(*before, *gaps)))

    def memory(self) -> bytes:
        """Return the memory for a successor; all missing readings have been published by now."""
        return msgspec.msgpack.encode(self._next)

    def remember(self, memory: bytes) -> None:
        """Restore a predecessor's memory; empty memory begins a new episode."""
        self._begin()
        if memory:
            self._next |= msgspec.msgpack.decode(memory, type=dict[str, int])
            self._cause = "restarted"

    def _beyond(self, output: str, reading: int) -> None:
        """Record all readings before `reading` that are not yet accounted for as missing."""
        self._miss(output, reading, self._cause)

    def _miss(self, output: str, end: int, cause: Cause) -> None:
        first, pending = self._next[output], self._pending[output]
        if first >= end:
            return
        self._next[output] = end
        if pending and (pending[-1].last, pending[-1].cause) == (first - 1, cause):
            first = pending.pop().first
        pending.append(_Missing(first, end - 1, cause))


class NoReadingLedger:
    """Null object for a sensor without due readings."""

    def because(self, cause: Cause) -> None:
        """Do nothing."""

    def published(self, output: str, nanos: int) -> None:
        """Do nothing."""

    def left_out(self, one: LeftOut) -> None:
        """Do nothing."""

    def report(
        self, settled_tick: int, *, stamp_nanos: int, epoch_nanos: int, again: bool = False
    ) -> None:
        """Do nothing."""

    def memory(self) -> bytes:
        """Return empty memory."""
        return b""

    def remember(self, memory: bytes) -> None:
        """Do nothing."""
