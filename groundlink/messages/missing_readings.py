# SPDX-License-Identifier: Apache-2.0
"""Missing readings: gaps that a sensor's process reports with their cause.

Each reading that is due by its `ReadingSchedule` is either published or in one gap. Readings that a
fault takes away on purpose are reported too, under the kind of the fault, so that sums add up.
"""

from __future__ import annotations

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
    "overloaded": "left out on purpose, as the sensor was behind and nobody waits for it",
    "states lost": "states of physics did not reach the sensor, or could not be used",
    "not there": "the sensor's process had not joined the run yet",
    "restarted": "the sensor's process ended, and what it missed could not be made up for",
    "world changed": "the measurement under way was of a world that is no more",
    "removed": "the sensor's vehicle was taken out of the world",
    "drop": "taken away by a fault of this kind",
    "off": "taken away by a fault of this kind",
    "rate_change": "taken away by a fault of this kind",
}
"""What each cause means."""

assert set(CAUSES) == set(get_args(Cause))

COUNTER_PREFIX = "gap_"
"""Of the counters of a sensor that say how many readings are missing by a cause."""


class MissingSpan(Struct, frozen=True):
    """Readings that follow one another and are missing for one cause."""

    cause: Cause
    first_nanos: int
    """Stamp that the first of them would have."""

    last_nanos: int
    """That of the last one."""

    readings: int
    """How many they are; of a sensor with several streams, on each of them."""

    outputs: tuple[str, ...]
    """The streams that lack them, by name as in `topics.sensor_outputs`."""


class MissingReadings(BusMessage, frozen=True):
    """What of a sensor's readings turned out to be missing since it told the last time."""

    stamp_nanos: int
    """The instant up to which the sensor has looked."""

    sensor: str
    """vehicle/sensor."""

    gaps: tuple[MissingSpan, ...]


def counters_of(missing: Mapping[Cause, int]) -> dict[str, int]:
    """Return the counters by which a process's health tells what is missing."""
    return {COUNTER_PREFIX + cause: count for cause, count in missing.items()}


def parted(counters: Mapping[str, int]) -> tuple[dict[str, int], dict[str, int]]:
    """Return what a process's counters tell of missing readings, by cause, and the others."""
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
