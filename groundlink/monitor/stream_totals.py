# SPDX-License-Identifier: Apache-2.0
"""Stream totals: stream reports summed over restarts of the gateway.

A gateway counts from its start, so its counts drop at a restart. The last report of each earlier
gateway is added.
"""

from collections.abc import Sequence

from msgspec.structs import replace

from groundlink.messages.base import Health, StreamReport

SUMMED = (
    *("messages", "lost", "sent", "missing", "incomplete", "late", "dropped", "in_flight"),
    *("repaired", "superseded", "delivered_bytes"),
)
"""Fields of `StreamReport` that count from the start of the gateway."""

_Key = tuple[str, str, str]


class StreamTotals:
    """Sums the reports of a gateway and its predecessors."""

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
