# SPDX-License-Identifier: Apache-2.0
"""When ticks are due by the wall clock.

Rule: the instant of a tick is one multiplication from that of tick 0, never a sum of waits: what
single steps are late by does not add up. Time comes in as an argument.
"""

from __future__ import annotations

from groundlink.clock import TICK_SECONDS


class Wall:
    """Tick k is due k * 2.5 ms / factor after tick 0, until time stretches or stands still.

    Parameters
    ----------
    factor
        sim seconds for each second of the wall's.
    catch_up_seconds
        Of the wall's: what a run is late by is made up for up to here, and given up beyond.
    """

    def __init__(self, factor: float, catch_up_seconds: float) -> None:
        self._tick_seconds = TICK_SECONDS / factor
        self._catch_up_seconds = catch_up_seconds
        self._zero: float | None = None

    def late_seconds(self, tick: int, now_seconds: float) -> float:
        """Return by how much a tick is overdue; less than 0 for how long until it is due."""
        if self._zero is None:
            self._zero = now_seconds - tick * self._tick_seconds
        return now_seconds - (self._zero + tick * self._tick_seconds)

    def stretched_seconds(self, tick: int, now_seconds: float) -> float:
        """Let a tick that is too late be due now; return by how much time has stretched."""
        late = self.late_seconds(tick, now_seconds)
        if late <= self._catch_up_seconds:
            return 0.0
        assert self._zero is not None
        self._zero += late
        return late

    def hold(self) -> None:
        """Let the next tick that is asked for be due at once: time stood still."""
        self._zero = None


class RealTimeFactor:
    """Measures sim seconds for each second of the wall's, from one look to the next."""

    def __init__(self) -> None:
        self._last: tuple[int, float] | None = None

    def since_last(self, tick: int, now_seconds: float) -> float | None:
        """Return the factor since the last look; None where there is none, or time jumped back."""
        last, self._last = self._last, (tick, now_seconds)
        if last is None or now_seconds <= last[1] or tick < last[0]:
            return None
        return (tick - last[0]) * TICK_SECONDS / (now_seconds - last[1])


class NoWall(Wall):
    """No clock to keep to: every tick is due, none is late."""

    def __init__(self) -> None:
        super().__init__(1.0, 0.0)

    def late_seconds(self, tick: int, now_seconds: float) -> float:
        """Return that a tick is due."""
        return 0.0
