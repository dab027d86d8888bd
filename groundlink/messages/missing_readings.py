# SPDX-License-Identifier: Apache-2.0
"""Missing readings: gaps that a sensor's process reports with their cause.

Each reading that is due by its `ReadingSchedule` is either published or in exactly one gap.
Readings that a fault suppresses are reported too, with the kind of the fault as their cause.
Published and missing readings therefore add up to the readings due.
"""

from collections.abc import Mapping
from typing import Literal, get_args

from msgspec import Struct

from .base import BusMessage

Cause = Literal[
    "overloaded",
    "states lost",
    "not there",
    "restarted",
    "world changed",
    "removed",
    "drop",
    "off",
    "rate_change",
]

CAUSES: Mapping[Cause, str] = {
    "overloaded": "dropped because the sensor was behind and the run does not wait (`skip`)",
    "states lost": "states did not reach the sensor's process, or lacked the measured body",
    "not there": "the sensor's process had not joined the run yet",
    "restarted": "the sensor's process ended, and the missed readings could not be recovered",
    "world changed": "the world changed during the measurement",
    "removed": "the sensor's vehicle was removed from the world",
    "drop": "suppressed by a fault of this kind",
    "off": "suppressed by a fault of this kind",
    "rate_change": "suppressed by a fault of this kind",
}
"""Description of each cause."""

assert set(CAUSES) == set(get_args(Cause))

COUNTER_PREFIX = "gap_"
"""Prefix of a sensor's health counters for missing readings; the cause follows."""


class MissingSpan(Struct, frozen=True):
    """Consecutive readings that are missing for the same cause."""

    cause: Cause
    first_nanos: int
    """Stamp of the first missing reading."""

    last_nanos: int
    """Stamp of the last missing reading."""

    readings: int
    """Number of missing readings on each of the streams."""

    outputs: tuple[str, ...]
    """Streams with missing readings, by name as in `topics.sensor_outputs`."""


class MissingReadings(BusMessage, frozen=True):
    """Missing readings of a sensor since its last report."""

    stamp_nanos: int
    """Instant up to which readings were checked."""

    sensor: str
    """Name as vehicle/sensor."""

    gaps: tuple[MissingSpan, ...]


def counters_of(missing: Mapping[Cause, int]) -> dict[str, int]:
    """Return missing readings by cause as health counters."""
    return {COUNTER_PREFIX + cause: count for cause, count in missing.items()}


def parted(counters: Mapping[str, int]) -> tuple[dict[str, int], dict[str, int]]:
    """Split health counters into missing readings by cause and all others."""
    missing = {
        name.removeprefix(COUNTER_PREFIX): count
        for name, count in counters.items()
        if name.startswith(COUNTER_PREFIX)
    }
    others = {n: count for n, count in counters.items() if not n.startswith(COUNTER_PREFIX)}
    return missing, others


def in_words(missing: Mapping[str, int]) -> str:
    """Return counts by cause as text, such as `3 overloaded, 1 restarted`; empty for none."""
    return ", ".join(f"{count} {cause}" for cause, count in missing.items() if count)
