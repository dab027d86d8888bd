# SPDX-License-Identifier: Apache-2.0
"""The random numbers of a revolution.

Rule: every ray has its numbers, whether it returns or not and whatever block it is in, so that what
one meets does not change another's noise, and blocks hold the very numbers of the revolution.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from services.sensors.noise.random_streams import RandomStreams
from services.sensors.rays.scene import Reals


class RevolutionDraws:
    """What has been drawn for the revolution under way, kept for its next block."""

    def __init__(self, streams: RandomStreams) -> None:
        self._streams = streams
        self._drawn: dict[str, tuple[int, Reals]] = {}

    def of(self, purpose: str, tick: int, draw: Callable[[np.random.Generator], Reals]) -> Reals:
        """Return what `draw` gives for a purpose and a revolution, which `tick` tells."""
        known = self._drawn.get(purpose)
        if known is None or known[0] != tick:
            known = self._drawn[purpose] = tick, draw(self._streams.at(purpose, tick))
        return known[1]
