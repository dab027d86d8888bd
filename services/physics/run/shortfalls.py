# SPDX-License-Identifier: Apache-2.0
"""Shortfalls of a real-time run: sensors that miss readings, and time that goes too slowly.

Rule: health messages, ticks and wall time come in as arguments; lines for the log come out, one
when a shortfall begins and one when it is over. Readings that faults take away are no shortfall,
nor are those from before a sensor joined the run.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Mapping
from typing import NamedTuple

from groundlink.core.clock import TICK_SECONDS
from groundlink.messages.base import Health
from groundlink.messages.missing_readings import in_words, parted
from groundlink.messages.stalls import by_name
from groundlink.scenario.faults import KINDS

WINDOW_SECONDS = 10.0
FULL_SECONDS = 8.0
"""Health messages that span less say nothing: a sensor that has just begun may still settle."""

LOOK_SECONDS = 1.0
"""A process tells its health as often."""

LOW, KEPT = 0.9, 0.98
"""Below the one share of what is declared a shortfall begins, from the other on it is over."""

SILENT_SECONDS = 4.0
"""A sensor's process that has told nothing for so long has no readings."""


_WANTED = frozenset({*KINDS, "not there"})


class _Beat(NamedTuple):
    seconds: float
    readings: int
    missing: Counter[str]


class _Sensor:
    """A sensor, over all episodes of its process."""

    def __init__(self) -> None:
        self.beats: deque[_Beat] = deque()
        self.low_since: float | None = None
        self.missing_before = 0
        """When the shortfall began."""

        self._process: tuple[str, int] | None = None
        self._last: tuple[int, Counter[str]] = 0, Counter()
        self._before: tuple[int, Counter[str]] = 0, Counter()

    def heard(self, health: Health, now_seconds: float) -> None:
        if self._process not in (None, process := (health.host, health.pid)):
            self._before = self._total
        self._process = process
        missing, counters = parted(health.counters)
        told = Counter({cause: n for cause, n in missing.items() if cause not in _WANTED})
        self._last = counters.get("readings", 0), told
        self.beats.append(_Beat(now_seconds, *self._total))
        while self.beats[0].seconds < now_seconds - WINDOW_SECONDS:
            self.beats.popleft()

    @property
    def _total(self) -> tuple[int, Counter[str]]:
        return self._before[0] + self._last[0], self._before[1] + self._last[1]


class ShortfallMonitor:
    """Looks after the sensors and the pace of a run.

    Parameters
    ----------
    factor
        sim seconds for each second of the wall's that the scenario declares.
    """

    def __init__(self, factor: float) -> None:
        self._factor = factor
        self._sensors: dict[str, _Sensor] = {}
        self._ticks: deque[tuple[float, int, Counter[str]]] = deque()
        self._slow_since: float | None = None
        self._next_look = 0.0

    def heard(self, health: Health, now_seconds: float) -> None:
        """Take note of a process's health."""
        self._sensors.setdefault(health.process, _Sensor()).heard(health, now_seconds)

    def rest(self) -> None:
        """Take note that time stands still, or jumps."""
        self._ticks.clear()

    def look(
        self,
        tick: int,
        now_seconds: float,
        declared_hz: Mapping[str, float],
        stretched_seconds: Mapping[str, float],
    ) -> list[str]:
        """Return what has changed since the last look; to be called often.

        Parameters
        ----------
        declared_hz
            rate of each sensor of the run.
        stretched_seconds
            wall time that the run has lost until now, by process.
        """
        if now_seconds < self._next_look:
            return []
        self._next_look = now_seconds + LOOK_SECONDS
        lines = self._pace(tick, now_seconds, Counter(stretched_seconds))
        for name, rate_hz in declared_hz.items():
            if sensor := self._sensors.get(name):
                lines += self._judged(name, sensor, rate_hz, now_seconds)
        return lines

    def _pace(self, tick: int, now: float, stretched: Counter[str]) -> list[str]:
        """Return what is to be said of the real-time factor."""
        self._ticks.append((now, tick, stretched))
        while self._ticks[0][0] < now - WINDOW_SECONDS - LOOK_SECONDS:
            self._ticks.popleft()
        begin, first, before = self._ticks[0]
        if now - begin < WINDOW_SECONDS:
            return []
        factor = (tick - first) * TICK_SECONDS / (now - begin)
        if self._slow_since is None and factor < LOW * self._factor:
            self._slow_since = begin
            causes = by_name({name: lost - before[name] for name, lost in stretched.items()})
            return [
                f"machine overloaded: real-time factor {factor:.2f} of {self._factor:g} in the "
                f"last {WINDOW_SECONDS:g} s" + (f" ({causes})" if causes else "")
            ]
        if self._slow_since is not None and factor >= KEPT * self._factor:
            after, self._slow_since = now - self._slow_since, None
            return [f"real-time factor is {self._factor:g} again after {after:.0f} s"]
        return []

    def _judged(self, name: str, sensor: _Sensor, rate_hz: float, now: float) -> list[str]:
        """Return what is to be said of a sensor."""
        first, last = sensor.beats[0], sensor.beats[-1]
        silent = now - last.seconds
        missing = last.missing - first.missing
        came, lost = last.readings - first.readings, missing.total()
        kept = came / (came + lost) if came + lost else 1.0
        if silent >= SILENT_SECONDS:
            kept = 0.0
        elif last.seconds - first.seconds < FULL_SECONDS:
            return []
        if sensor.low_since is None and kept < LOW:
            sensor.low_since = last.seconds if silent >= SILENT_SECONDS else first.seconds
            sensor.missing_before = first.missing.total()
            if silent >= SILENT_SECONDS:
                return [f"{name}: no readings for {silent:.0f} s: its process is silent"]
            overloaded = "machine overloaded: " if missing["overloaded"] else ""
            return [
                f"{name}: {kept * rate_hz:.1f} of {rate_hz:g} Hz ({overloaded}readings missing in "
                f"the last {last.seconds - first.seconds:.0f} s: {in_words(missing)})"
            ]
        if sensor.low_since is not None and kept >= KEPT:
            after, sensor.low_since = now - sensor.low_since, None
            lost = last.missing.total() - sensor.missing_before
            return [f"{name}: {rate_hz:g} Hz again after {after:.0f} s, {lost} readings missing"]
        return []
