# SPDX-License-Identifier: Apache-2.0
"""Correlated errors: Gauss-Markov processes and random walks, as functions of the tick.

A value depends on seed, sensor, purpose and tick, not on when the process was started. The values
at the ends of blocks of 128 ticks are one recursion from tick 0, which takes some 10 ms to catch up
with an hour of sim time. The values within a block are drawn on their own and tied to both ends (a
bridge), so they need nothing else of the past. The process is exact at every tick.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from groundlink.core.clock import TICK_SECONDS

from .normal import NORMALS
from .random_streams import RandomStreams

BLOCK_TICKS = 128
"""Ticks whose values are drawn from one stream, to share the cost of its setup."""

BLOCKS_PER_DRAW = 1024
"""Ends of blocks that are drawn from one stream."""


class ErrorProcesses:
    """Independent processes x(k+1) = phi x(k) + q w(k), a column each, one step a tick.

    Parameters
    ----------
    streams, purpose, noise_source
        Source of the numbers; `noise_source` is a key of `NORMALS`.
    stddevs : shape (n,)
        Of a Gauss-Markov process at any tick, including tick 0; of a random walk, which starts at
        0, after one second.
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
        # Rows m = 0 .. BLOCK_TICKS: decay after m steps, and variance gained in them.
        steps = np.arange(BLOCK_TICKS + 1)[:, None]
        self._left = np.exp(-decay * steps)
        gained = np.vstack([np.zeros_like(sigma), np.cumsum(self._left[:-1] ** 2, axis=0)])
        self._whole_step = step * np.sqrt(gained[-1])
        self._weights = step / self._left[1:]
        # Share of a block's innovation at its end to expect after m steps.
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
            values = self._left[-1] * values + self._whole_step * self._innovation(reached)
            reached += 1
        self._reached = (reached, values)
        return values

    def _innovation(self, index: int) -> NDArray[np.float64]:
        """Return the normal numbers that block `index` adds at its end."""
        draw, row = divmod(index, BLOCKS_PER_DRAW)
        if draw != self._drawn[0]:
            generator = self._streams.at(self._purpose, draw * BLOCKS_PER_DRAW * BLOCK_TICKS)
            columns = len(self._start)
            normal = self._normals(generator).draw(BLOCKS_PER_DRAW * columns)
            self._drawn = (draw, normal.reshape(-1, columns))
        innovation: NDArray[np.float64] = self._drawn[1][row]
        return innovation
