# SPDX-License-Identifier: Apache-2.0
"""When ticks are due by the wall clock.

Rule: the instant of a tick is one multiplication from that of tick 0, never a sum of waits: what
single steps are late by does not add up. Time comes in as an argument.
"""

from __future__ import annotations

from groundlink.core.clock import TICK_SECONDS


class WallClock:
    """Tick k is due k * 2.5 ms / factor after tick 0; after a hold-up, later and then faster.

    A run that is late steps as fast as it can until it is on time. What it is late by beyond
    `at_once_seconds` is its debt: the next ticks are due that much later, and a fraction `slew`
    closer to each other until the debt is paid.

    Parameters
    ----------
    factor
        sim seconds for each second of the wall's.
    at_once_seconds
        Of the wall's: lateness that is made up for as fast as the run can step.
    slew
        how much faster than `factor` ticks are due while there is a debt, as a fraction of it.
    most_debt_seconds
        Of the wall's: a larger debt is written off. With 0, every debt is.
    """

    def __init__(
        self,
        factor: float,
        at_once_seconds: float,
        *,
        slew: float = 0.0,
        most_debt_seconds: float = 0.0,
    ) -> None:
        self._tick_seconds = TICK_SECONDS / factor
        self._paid_a_tick_seconds = self._tick_seconds * slew / (1.0 + slew)
        self._at_once_seconds = at_once_seconds
        self._most_debt_seconds = most_debt_seconds
        self._zero: float | None = None
        self._debt_tick, self._debt_seconds = 0, 0.0
        self.written_off_seconds = 0.0
        """Wall time by which the run stays late for good."""

    def debt_seconds(self, tick: int) -> float:
        """Return how much later than without hold-ups a tick is due."""
        if not self._debt_seconds:
            return 0.0
        paid = (tick - self._debt_tick) * self._paid_a_tick_seconds
        return max(self._debt_seconds - paid, 0.0)

    def late_seconds(self, tick: int, now_seconds: float) -> float:
        """Return by how much a tick is overdue; less than 0 for how long until it is due."""
        if self._zero is None:
            self._zero = now_seconds - tick * self._tick_seconds
        return now_seconds - (self._zero + tick * self._tick_seconds + self.debt_seconds(tick))

    def lost_seconds(self, tick: int, now_seconds: float) -> float:
        """Account for a tick that is about to be stepped; return what it adds to the debt.

        A debt shrinks only by ticks that are stepped on time: a run that cannot keep up does not
        pay anything back, and owes nothing twice.
        """
        late = self.late_seconds(tick, now_seconds)
        if late <= 0.0:
            self._debt_tick, self._debt_seconds = tick, self.debt_seconds(tick)
            return 0.0
        if late <= self._at_once_seconds:
            return 0.0
        debt = self.debt_seconds(tick) + late - self._at_once_seconds
        lost = max(debt - self._debt_seconds, 0.0)
        if debt > self._most_debt_seconds:
            assert self._zero is not None
            self._zero += debt
            self.written_off_seconds += debt
            debt = 0.0
        self._debt_tick, self._debt_seconds = tick, debt
        return lost

    def hold(self) -> None:
        """Let the next tick that is asked for be due at once: time stood still."""
        self._zero = None
        self._debt_seconds = 0.0


class RealTimeFactorMeter:
    """Measures sim seconds for each second of the wall's, from one look to the next."""

    def __init__(self) -> None:
        self._last: tuple[int, float] | None = None

    def since_last(self, tick: int, now_seconds: float) -> float | None:
        """Return the factor since the last look; None where there is none, or time jumped back."""
        last, self._last = self._last, (tick, now_seconds)
        if last is None or now_seconds <= last[1] or tick < last[0]:
            return None
        return (tick - last[0]) * TICK_SECONDS / (now_seconds - last[1])


class NoWallClock(WallClock):
    """No clock to keep to: every tick is due, none is late."""

    def __init__(self) -> None:
        super().__init__(1.0, 0.0)

    def late_seconds(self, tick: int, now_seconds: float) -> float:
        """Return that a tick is due."""
        return 0.0
