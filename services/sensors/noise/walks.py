# SPDX-License-Identifier: Apache-2.0
"""Errors that wander: Gauss-Markov processes and random walks, as functions of the tick.

Rule: a walk depends on the seed, the sensor, the purpose and the tick, like every draw, and not on
when its process was started. Its values at the ends of blocks of 128 ticks are one recursion from
tick 0 on, which takes some 10 ms for each hour of sim time to catch up with; what lies between two
ends is drawn for each block by itself and tied to both (a bridge), so that nothing else of the past
is needed. At the ticks the process is exact, whatever the block.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from groundlink.core.clock import TICK_SECONDS

from .normal import NORMALS
from .random_streams import RandomStreams

BLOCK_TICKS = 128
"""Ticks whose values are drawn together, from one stream: spreads the cost of its set-up."""

BLOCKS_PER_DRAW = 1024
"""Ends of blocks that are drawn together."""


class ErrorProcesses:
    """Independent processes x(k+1) = phi x(k) + q w(k), one a column, a step a tick.

    Parameters
    ----------
    streams, purpose, noise_source
        Where the numbers come from, and which of `NORMALS`.
    stddevs : shape (n,)
        Of a Gauss-Markov process its own, which it has at tick 0 as at any other; of a random walk
        what it has after a second. Random walks begin at 0.
    time_constants_s : shape (n,)
        phi = exp(-tick / time constant); infinite for a random walk.
    """

    def __init__(
        self,
        streams: RandomStreams,
        purpose: str,
        *,
        stddevs: ArrayLike,
        time_constants_s: ArrayLike,
        noise_source: str,
    ) -> None:
        self._streams = streams
        self._purpose = purpose
        self._normals = NORMALS[noise_source]
        sigma = np.asarray(stddevs, np.float64)
        decay = TICK_SECONDS / np.asarray(time_constants_s, np.float64)
        walking = decay == 0
        step = sigma * np.sqrt(np.where(walking, TICK_SECONDS, -np.expm1(-2 * decay)))
        self._start = np.where(walking, 0.0, sigma)
        # Rows m = 0 .. BLOCK_TICKS: what is left after m steps, and the variance gained in them.
        steps = np.arange(BLOCK_TICKS + 1)[:, None]
        self._left = np.exp(-decay * steps)
        gained = np.vstack([np.zeros_like(sigma), np.cumsum(self._left[:-1] ** 2, axis=0)])
        self._whole_step = step * np.sqrt(gained[-1])
        self._weights = step / self._left[1:]
        # Of a block's surprise at its end, the share to expect after m steps.
        self._tie = gained * self._left[::-1] / gained[-1]
        self._drawn: tuple[int, NDArray[np.float64]] = (-1, np.empty((0, 0)))
        self._reached: tuple[int, NDArray[np.float64]] = (-1, np.empty(0))

    def block(self, index: int) -> NDArray[np.float64]:
        """Return the values at ticks index * 128 to index * 128 + 127, shape (128, n)."""
        begin, end = self._end(index), self._end(index + 1)
        generator = self._streams.at(f"{self._purpose}_within", index * BLOCK_TICKS)
        normal = self._normals(generator).draw(BLOCK_TICKS * len(begin)).reshape(BLOCK_TICKS, -1)
        free = np.vstack([begin, begin + np.cumsum(self._weights * normal, axis=0)]) * self._left
        tied: NDArray[np.float64] = free + self._tie * (end - free[-1])
        return tied[:-1]

    def _end(self, index: int) -> NDArray[np.float64]:
        """Return the values at the first tick of block `index`."""
        reached, values = self._reached
        if reached < 0 or index < reached:
            start = self._streams.at(f"{self._purpose}_start", 0)
            reached, values = 0, self._start * self._normals(start).draw(len(self._start))
        while reached < index:
            values = self._left[-1] * values + self._whole_step * self._surprise(reached)
            reached += 1
        self._reached = (reached, values)
        return values

    def _surprise(self, index: int) -> NDArray[np.float64]:
        """Return the normal numbers that block `index` adds at its end."""
        draw, row = divmod(index, BLOCKS_PER_DRAW)
        if draw != self._drawn[0]:
            generator = self._streams.at(self._purpose, draw * BLOCKS_PER_DRAW * BLOCK_TICKS)
            columns = len(self._start)
            normal = self._normals(generator).draw(BLOCKS_PER_DRAW * columns)
            self._drawn = (draw, normal.reshape(-1, columns))
        surprise: NDArray[np.float64] = self._drawn[1][row]
        return surprise
