# SPDX-License-Identifier: Apache-2.0
"""When ticks are due by the wall clock. Time comes in as an argument.

The due time of a tick is one multiplication from that of tick 0, never a sum of waits: the lateness
of single steps does not add up.
"""

from groundlink.core.clock import TICK_SECONDS


class WallClock:
    """Tick k is due k * 2.5 ms / factor after tick 0; after a stall, later and then faster.

    A late run steps as fast as it can until it is on time. Lateness beyond `at_once_seconds` is its
    debt: the next ticks are due that much later, and closer to each other until the debt is paid.

    Parameters
    ----------
    factor
        sim seconds for each second of wall time.
    at_once_seconds
        wall time: lateness that is made up for as fast as the run can step.
    slew
        how much faster than `factor` ticks are due while there is a debt, as a fraction of it.
    most_debt_seconds
        wall time: a larger debt is written off. With 0, every debt is.

    Attributes
    ----------
    written_off_seconds
        wall time by which the run stays late for good.
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

    def debt_seconds(self, tick: int) -> float:
        """Return how much later than without stalls a tick is due."""
        if not self._debt_seconds:
            return 0.0
        paid = (tick - self._debt_tick) * self._paid_a_tick_seconds
        return max(self._debt_seconds - paid, 0.0)

    def late_seconds(self, tick: int, now_seconds: float) -> float:
        """Return by how much a tick is overdue; negative: how long until it is due."""
        if self._zero is None:
            self._zero = now_seconds - tick * self._tick_seconds
        return now_seconds - (self._zero + tick * self._tick_seconds + self.debt_seconds(tick))

    def lost_seconds(self, tick: int, now_seconds: float) -> float:
        """Account for a tick that is about to be stepped; return what it adds to the debt.

        Only ticks that are stepped on time pay the debt: a run that cannot keep up pays nothing
        back, and no lateness is counted twice.
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

    def restart(self) -> None:
        """Make the next tick due when it is asked for: time stood still."""
        self._zero = None
        self._debt_seconds = 0.0


class NoWallClock(WallClock):
    """Stands for the wall clock of a fast run: every tick is due, none is late."""

    def __init__(self) -> None:
        super().__init__(1.0, 0.0)

    def late_seconds(self, tick: int, now_seconds: float) -> float:
        """Return zero."""
        return 0.0


class RealTimeFactorMeter:
    """Measures sim seconds for each second of wall time between calls."""

    def __init__(self) -> None:
        self._last: tuple[int, float] | None = None

    def since_last(self, tick: int, now_seconds: float) -> float | None:
        """Return the factor since the last call; None for the first, or when time jumped back."""
        last, self._last = self._last, (tick, now_seconds)
        if last is None or now_seconds <= last[1] or tick < last[0]:
            return None
        return (tick - last[0]) * TICK_SECONDS / (now_seconds - last[1])
