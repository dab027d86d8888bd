# SPDX-License-Identifier: Apache-2.0
"""Reading ledger: whether each reading of a sensor was published or is missing, and why.

Every reading that is due is entered once and in order, for each stream. A gap is found when a later
reading is published or the sensor has passed its time, so models report only what they leave out on
purpose. Gaps that were published shortly before a link broke may be lost; they are published again.
"""

from __future__ import annotations

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
"""Gaps published this recently are published again after a reconnect. A dead link is noticed after
10 s at the latest, and the next link may end with it."""


class _Missing(NamedTuple):
    """Readings of one stream that follow one another."""

    first: int
    last: int
    cause: Cause


class ReadingLedger:
    """The account of one sensor.

    Parameters
    ----------
    sensor
        vehicle/sensor.
    outputs
        Names of its streams.
    publish
        Tells the run what is missing.

    Attributes
    ----------
    missing : Counter
        Readings that were told of, by cause.
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
        self._told: deque[MissingReadings] = deque()
        """Of this episode, and not long ago."""

        self._begin()

    def _begin(self) -> None:
        """Begin an episode of physics: from tick 0 on, whenever the sensor has joined it."""
        self._told.clear()
        self._next = dict.fromkeys(self._outputs, self._calendar.first)
        self._pending: dict[str, list[_Missing]] = {output: [] for output in self._outputs}
        self._cause: Cause = "not there"

    def because(self, cause: Cause) -> None:
        """Take note why the readings are missing that will turn out to be from now on."""
        self._cause = cause

    def published(self, output: str, nanos: int) -> None:
        """Take note of a reading, stamped with this sim time, that went out."""
        reading = self._calendar.at_or_after(nanos)
        self._beyond(output, reading)
        self._next[output] = max(self._next[output], reading + 1)

    def left_out(self, one: LeftOut) -> None:
        """Take note of a reading that does not go out."""
        reading = self._calendar.at_or_after(one.nanos)
        for output in self._outputs if one.output is None else (one.output,):
            self._beyond(output, reading)
            self._miss(output, reading + 1, one.cause)

    def tell(
        self, settled_tick: int, *, stamp_nanos: int, epoch_nanos: int, again: bool = False
    ) -> None:
        """Tell the run what is missing, where something is.

        Parameters
        ----------
        settled_tick
            Nothing that is stamped before it is still to come.
        stamp_nanos
            The instant of the last state.
        again
            Tell what was told of late once more.
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
        told = MissingReadings(stamp_nanos, self._sensor, tuple(gaps))
        while self._told and stamp_nanos - self._told[0].stamp_nanos > AGAIN_NANOS:
            self._told.popleft()
        before = [gap for one in self._told for gap in one.gaps] if again else []
        if gaps:
            self._told.append(told)
        if before or gaps:
            self._publish(replace(told, gaps=(*before, *gaps)))

    def memory(self) -> bytes:
        """Return what a successor has to know; what is missing has been told."""
        return msgspec.msgpack.encode(self._next)

    def remember(self, memory: bytes) -> None:
        """Go on from a predecessor's memory; from an empty one, begin anew."""
        self._begin()
        if memory:
            self._next |= msgspec.msgpack.decode(memory, type=dict[str, int])
            self._cause = "restarted"

    def _beyond(self, output: str, reading: int) -> None:
        """Take note that all before a reading, which is not accounted for yet, are missing."""
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
    """Stands for the account of what owes nothing."""

    def because(self, cause: Cause) -> None:
        """Do nothing."""

    def published(self, output: str, nanos: int) -> None:
        """Do nothing."""

    def left_out(self, one: LeftOut) -> None:
        """Do nothing."""

    def tell(
        self, settled_tick: int, *, stamp_nanos: int, epoch_nanos: int, again: bool = False
    ) -> None:
        """Do nothing."""

    def memory(self) -> bytes:
        """Return nothing."""
        return b""

    def remember(self, memory: bytes) -> None:
        """Do nothing."""
