# SPDX-License-Identifier: Apache-2.0
"""Blocks of firings that a LiDAR's revolutions are sent in: their firings and their ends.

All but the last block of a revolution end with their last ray, which may leave after the next
firing has begun. The last block ends where the next revolution begins, or with its last ray if the
head does not fire until then.
"""

import numpy as np

from groundlink.core.clock import NANOS, TICK_NANOS
from groundlink.core.frames import Floats
from groundlink.messages.reading_schedule import Blocks
from groundlink.scenario.sensors import RotatingLidar
from services.sensors.rays.scene import Reals

from .sweep import Sweep


class FiringBlocks(Blocks):
    """The blocks of one LiDAR."""

    def __init__(self, spec: RotatingLidar, sweep: Sweep) -> None:
        super().__init__(spec)
        self._late_nanos = round(sweep.latest_seconds * NANOS)

    def since_start(self, seconds: Floats) -> Reals:
        """Convert instants since the revolution's start to instants since the block's start.

        Parameters
        ----------
        seconds : float64 array, shape (lasers, firings)
        """
        starts = np.array(self.first_firings[:-1]) / float(self.firing_times.rate_hz)
        return (seconds - np.repeat(starts, np.diff(self.first_firings))).astype(np.float32)

    def firings(self, blocks: range) -> tuple[int, range]:
        """Return the revolution of some blocks and their firings in it."""
        revolution, index = divmod(blocks.start, self.per_revolution)
        first = self.first_firings
        return revolution, range(first[index], first[index + len(blocks)])

    def first_tick(self, block: int) -> int:
        """Return the last tick that is not after a block's start."""
        return self.nanos(block) // TICK_NANOS

    def end_tick(self, block: int) -> int:
        """Return the tick whose state completes a block."""
        revolution, index = divmod(block, self.per_revolution)
        after = revolution * self.firings_per_turn + self.first_firings[index + 1]
        end = self.firing_times.tick(after)
        if after % self.firings_per_turn == 0:
            return end
        latest = self.firing_times.nanos(after - 1) + self._late_nanos
        return max(end, -(-latest // TICK_NANOS))

    def complete_by(self, tick: int, block: int) -> int:
        """Return the end of the blocks from `block` on that a tick's state completes.

        They belong to the revolution of `block`, which is complete.
        """
        last = (block // self.per_revolution + 1) * self.per_revolution
        end = block + 1
        while end < last and self.end_tick(end) <= tick:
            end += 1
        return end
