# SPDX-License-Identifier: Apache-2.0
"""When physics may take its next step: by the wall clock, or as fast as the others follow.

Rule: time and acknowledgements come in as arguments. A pace answers how long to wait; it does not
wait itself.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping

from groundlink.clock import TICK_SECONDS
from groundlink.messages import Ack

CATCH_UP_SECONDS = 0.2
"""Longer hold-ups are not made up for: time stretches, so that sensors are not overrun."""


class RealTime:
    """Paced by the wall clock: tick k is due k * 2.5 ms / factor after the start."""

    def __init__(self, factor: float) -> None:
        self._tick_seconds = TICK_SECONDS / factor
        self._start: float | None = None
        self.stretched_seconds = 0.0
        """Wall time by which the run has fallen behind for good."""

    def wait_seconds(self, tick: int, now_seconds: float) -> float:
        """Return how long to wait at `now_seconds` before stepping to `tick`; 0 for not at all."""
        if self._start is None:
            self._start = now_seconds - tick * self._tick_seconds
        ahead = self._start + tick * self._tick_seconds - now_seconds
        if ahead < -CATCH_UP_SECONDS:
            self._start -= ahead
            self.stretched_seconds -= ahead
        return max(ahead, 0.0)

    def hold(self) -> None:
        """Let the next tick be due at once when it is asked for again: time stood still."""
        self._start = None

    def acknowledged(self, process: str, ack: Ack) -> None:
        """Take note of nothing: in real time no sensor is waited for."""

    def left(self, process: str) -> None:
        """Take note of nothing: in real time no sensor is waited for."""

    def only(self, needed: Collection[str]) -> None:
        """Take note of nothing: in real time no sensor is waited for."""

    def missing(self) -> list[str]:
        """Return the processes that are waited for: none."""
        return []


class AsFastAsOthers:
    """Free of the wall clock, at most a window of ticks ahead of each process that matters.

    Parameters
    ----------
    windows
        how many ticks physics may be ahead of each of the processes that must have joined before
        the first step and are waited for always.
    window_ticks
        how far it may be ahead of others (a gateway, a viewer), which are waited for from their
        first ack to their leave.
    """

    def __init__(self, windows: Mapping[str, int], window_ticks: int, life: int) -> None:
        self._windows = dict(windows)
        self._window = window_ticks
        self._life = life
        self._reached: dict[str, int] = {}
        self._next_tick = 0

    def hold(self) -> None:
        """Take note of nothing: no clock runs on meanwhile."""

    def acknowledged(self, process: str, ack: Ack) -> None:
        """Take note of how far a process has come in this life of the run."""
        if ack.life == self._life:
            self._reached[process] = ack.tick

    def left(self, process: str) -> None:
        """Stop waiting for a process that has gone, unless the run needs it."""
        if process not in self._windows:
            self._reached.pop(process, None)

    def only(self, needed: Collection[str]) -> None:
        """Wait no longer for processes that the run needed and that are not among these."""
        for process in self._windows.keys() - needed:
            self._reached.pop(process, None)
        self._windows = {p: window for p, window in self._windows.items() if p in needed}

    def wait_seconds(self, tick: int, now_seconds: float) -> float:
        """Return 0 when the step to `tick` is granted, else how long to wait and ask again."""
        self._next_tick = tick
        return 0.001 if self.missing() else 0.0

    def missing(self) -> list[str]:
        """Return the processes that hold up the next step."""
        absent = self._windows.keys() - self._reached.keys()
        behind = (
            name
            for name, reached in self._reached.items()
            if reached < self._next_tick - self._windows.get(name, self._window)
        )
        return sorted([*absent, *behind])


class Promises:
    """Holds the acknowledgements of drivers back until the commands that they speak of are here.

    The bus keeps the order of one key, not that of a command and an acknowledgement. A driver's
    `settled_tick` is that of its newest command's stamp.

    Parameters
    ----------
    drivers
        the vehicle that each driver drives, by the driver's process.
    """

    def __init__(self, drivers: Mapping[str, str]) -> None:
        self._drivers = drivers
        self._held: dict[str, Ack] = {}
        self._commanded: dict[str, int] = {}

    def change(self, drivers: Mapping[str, str]) -> None:
        """Know other drivers from now on."""
        self._drivers = drivers

    def commanded(self, vehicle: str, tick: int) -> None:
        """Take note of a command for `vehicle` that is stamped with `tick`."""
        self._commanded[vehicle] = max(tick, self._commanded.get(vehicle, -1))

    def given(self, process: str, ack: Ack) -> None:
        """Take an acknowledgement."""
        self._held[process] = ack

    def kept(self) -> Iterator[tuple[str, Ack]]:
        """Yield each process and acknowledgement that holds now, once."""
        for process, ack in list(self._held.items()):
            vehicle = self._drivers.get(process)
            if vehicle is None or ack.settled_tick <= self._commanded.get(vehicle, -1):
                yield process, self._held.pop(process)
