# SPDX-License-Identifier: Apache-2.0
"""The blocks that a LiDAR's revolutions are sent in: which firings they hold, and when they end.

Rule: arithmetic on the time line. Blocks are counted from the run's start, as are revolutions; a
whole revolution is the only block of itself. All but the last block of a revolution end with their
last ray, which may leave after the next firing has begun; the last ends where the next revolution
begins, or with its last ray where nothing is fired before that.
"""

from __future__ import annotations

from bisect import bisect_left

import numpy as np

from groundlink.clock import NANOS, TICK_NANOS, Schedule
from groundlink.frames import Floats
from groundlink.scenario.sensors import RotatingLidar
from services.sensors.rays.scene import Reals

from .sweep import Sweep


class Blocks:
    """The blocks of one LiDAR."""

    def __init__(self, spec: RotatingLidar, sweep: Sweep) -> None:
        self._count = spec.blocks_per_revolution
        self._first = sweep.first_firings
        self._firings = spec.firings_per_revolution
        self._late_nanos = round(sweep.latest_seconds * NANOS)
        self._schedule = Schedule(Schedule.at(spec.rotation_rate_hz).rate_hz * self._firings)
        """Of firings."""

    def since_start(self, seconds: Floats) -> Reals:
        """Return instants after the start of the revolution as instants after that of the block.

        Parameters
        ----------
        seconds : float64 array, shape (lasers, firings)
        """
        starts = np.array(self._first[:-1]) / float(self._schedule.rate_hz)
        return (seconds - np.repeat(starts, np.diff(self._first))).astype(np.float32)

    def firings(self, blocks: range) -> tuple[int, range]:
        """Return the revolution of some blocks and their firings in it."""
        revolution, index = divmod(blocks.start, self._count)
        return revolution, range(self._first[index], self._first[index + len(blocks)])

    def nanos(self, block: int) -> int:
        """Return the sim time of a block's first firing, rounded down."""
        return self._schedule.nanos(self._firing(block))

    def first_tick(self, block: int) -> int:
        """Return the last tick that is not after a block's start."""
        return self.nanos(block) // TICK_NANOS

    def end_tick(self, block: int) -> int:
        """Return the tick by whose state a block can be measured."""
        revolution, index = divmod(block, self._count)
        after = revolution * self._firings + self._first[index + 1]
        end = self._schedule.tick(after)
        if after % self._firings == 0:
            return end
        latest = self._schedule.nanos(after - 1) + self._late_nanos
        return max(end, -(-latest // TICK_NANOS))

    def first_at_or_after(self, tick: int) -> int:
        """Return the first block that begins at a tick or later."""
        revolution, firing = divmod(self._schedule.first_at_or_after(tick), self._firings)
        return revolution * self._count + bisect_left(self._first[:-1], firing)

    def complete_by(self, tick: int, block: int) -> int:
        """Return where the blocks end that can be measured by a tick's state.

        They begin with `block`, which can be, and are of its revolution.
        """
        last = (block // self._count + 1) * self._count
        end = block + 1
        while end < last and self.end_tick(end) <= tick:
            end += 1
        return end

    def _firing(self, block: int) -> int:
        """Return a block's first firing, counted from the run's start."""
        revolution, index = divmod(block, self._count)
        return revolution * self._firings + self._first[index]
