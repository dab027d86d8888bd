# SPDX-License-Identifier: Apache-2.0
"""What became of each stream over all lives of the gateway that reports it.

Rule: a gateway counts from its own start, so its counts drop when it is restarted. Reports come in;
what an earlier gateway last reported is added to them.
"""

from __future__ import annotations

from collections.abc import Sequence

from msgspec.structs import replace

from groundlink.messages.base import Health, StreamReport

SUMMED = (
    *("messages", "lost", "sent", "missing", "incomplete", "late", "dropped", "in_flight"),
    *("repaired", "superseded", "delivered_bytes"),
)
"""Fields of `StreamReport` that count from the gateway's start."""

_Key = tuple[str, str, str]


class StreamTotals:
    """Adds up the reports of a gateway and of those before it."""

    def __init__(self) -> None:
        self._process: tuple[str, int] | None = None
        self._last: dict[_Key, StreamReport] = {}
        self._before: dict[_Key, StreamReport] = {}

    def of(self, health: Health) -> Sequence[StreamReport]:
        """Return the streams of a gateway's health message with the counts of all lives."""
        process = health.host, health.pid
        anew = self._process not in (None, process)
        self._process = process
        rows = {_key(row): row for row in health.streams}
        for key, last in self._last.items():
            # A gateway whose vehicles or peer changed counts anew in the same process.
            if anew or (key in rows and rows[key].sent < last.sent):
                self._before[key] = _sum(last, self._before.get(key))
        self._last = rows
        return [_sum(row, self._before.get(_key(row))) for row in health.streams]


def _key(row: StreamReport) -> _Key:
    return row.direction, row.type, row.topic


def _sum(row: StreamReport, before: StreamReport | None) -> StreamReport:
    """Return a report with the counts of both, the rate over both, and the newer one's ages."""
    if before is None:
        return row
    reported = row.reported or before.reported
    counts = {field: getattr(row, field) + getattr(before, field) for field in SUMMED}
    return replace(row, **counts, measured_hz=_rate_hz(row, before), reported=reported)


def _rate_hz(*rows: StreamReport) -> float | None:
    """Return the rate over the times in which something was measured."""
    measured = [(row.messages - 1, row.measured_hz) for row in rows if row.measured_hz]
    seconds = sum(periods / rate_hz for periods, rate_hz in measured)
    return sum(periods for periods, _ in measured) / seconds if seconds > 0 else None
