# SPDX-License-Identifier: Apache-2.0
"""Shortfalls of a real-time run: sensors that miss readings, and time that goes too slowly.

Health messages, ticks and wall time come in as arguments, log lines come out: one when a shortfall
begins and one when it ends. Readings that faults remove do not count, nor do those from before a
sensor joined the run.
"""

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
"""Health messages that span less do not count: a sensor that has just started may still settle."""

CHECK_SECONDS = 1.0
"""Time between two health messages of a process."""

LOW, NORMAL = 0.9, 0.98
"""Shares of the declared rate: a shortfall begins below the first and ends at the second."""

SILENT_SECONDS = 4.0
"""A sensor whose process has sent no health message for so long has no readings."""

_WANTED = frozenset({*KINDS, "not there"})


class _Beat(NamedTuple):
    seconds: float
    readings: int
    missing: Counter[str]


class _Sensor:
    """A sensor, also when its process is restarted."""

    def __init__(self) -> None:
        self.beats: deque[_Beat] = deque()
        self.low_since: float | None = None
        self.missing_before = 0
        """Missing readings when the shortfall began."""

        self._process: tuple[str, int] | None = None
        self._last: tuple[int, Counter[str]] = 0, Counter()
        self._before: tuple[int, Counter[str]] = 0, Counter()

    def received(self, health: Health, now_seconds: float) -> None:
        if self._process not in (None, process := (health.host, health.pid)):
            self._before = self._total
        self._process = process
        missing, counters = parted(health.counters)
        counted = Counter({cause: n for cause, n in missing.items() if cause not in _WANTED})
        self._last = counters.get("readings", 0), counted
        self.beats.append(_Beat(now_seconds, *self._total))
        while self.beats[0].seconds < now_seconds - WINDOW_SECONDS:
            self.beats.popleft()

    @property
    def _total(self) -> tuple[int, Counter[str]]:
        return self._before[0] + self._last[0], self._before[1] + self._last[1]


class ShortfallMonitor:
    """Monitors the sensors and the speed of a run.

    Parameters
    ----------
    factor
        sim seconds for each second of wall time that the scenario declares.
    """

    def __init__(self, factor: float) -> None:
        self._factor = factor
        self._sensors: dict[str, _Sensor] = {}
        self._ticks: deque[tuple[float, int, Counter[str]]] = deque()
        self._slow_since: float | None = None
        self._next_check = 0.0

    def received(self, health: Health, now_seconds: float) -> None:
        """Take a health message."""
        self._sensors.setdefault(health.process, _Sensor()).received(health, now_seconds)

    def pause(self) -> None:
        """Restart the measurement of speed: time stands still, or jumps."""
        self._ticks.clear()

    def check(
        self,
        tick: int,
        now_seconds: float,
        declared_hz: Mapping[str, float],
        stretched_seconds: Mapping[str, float],
    ) -> list[str]:
        """Return log lines on changes since the last call; to be called often.

        Parameters
        ----------
        declared_hz
            rate of each sensor of the run.
        stretched_seconds
            wall time that the run has lost so far, by process.
        """
        if now_seconds < self._next_check:
            return []
        self._next_check = now_seconds + CHECK_SECONDS
        lines = self._check_speed(tick, now_seconds, Counter(stretched_seconds))
        for name, rate_hz in declared_hz.items():
            if sensor := self._sensors.get(name):
                lines += self._check_sensor(name, sensor, rate_hz, now_seconds)
        return lines

    def _check_speed(self, tick: int, now: float, stretched: Counter[str]) -> list[str]:
        """Return log lines on the real-time factor."""
        self._ticks.append((now, tick, stretched))
        while self._ticks[0][0] < now - WINDOW_SECONDS - CHECK_SECONDS:
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
        if self._slow_since is not None and factor >= NORMAL * self._factor:
            after, self._slow_since = now - self._slow_since, None
            return [f"real-time factor is {self._factor:g} again after {after:.0f} s"]
        return []

    def _check_sensor(self, name: str, sensor: _Sensor, rate_hz: float, now: float) -> list[str]:
        """Return log lines on a sensor."""
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
                return [f"{name}: no readings for {silent:.0f} s: its process does not respond"]
            overloaded = "machine overloaded: " if missing["overloaded"] else ""
            return [
                f"{name}: {kept * rate_hz:.1f} of {rate_hz:g} Hz ({overloaded}readings missing in "
                f"the last {last.seconds - first.seconds:.0f} s: {in_words(missing)})"
            ]
        if sensor.low_since is not None and kept >= NORMAL:
            after, sensor.low_since = now - sensor.low_since, None
            lost = last.missing.total() - sensor.missing_before
            return [f"{name}: {rate_hz:g} Hz again after {after:.0f} s, {lost} readings missing"]
        return []
