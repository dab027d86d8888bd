# SPDX-License-Identifier: Apache-2.0
"""Random numbers of a revolution.

Every ray has its own numbers, whether it returns or not and whatever block it is in. So a hit does
not change another ray's noise, and blocks have the same numbers as the whole revolution.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from services.sensors.noise.random_streams import RandomStreams

Drawn = TypeVar("Drawn", bound=NDArray[Any])


class RevolutionDraws:
    """Numbers of the present revolution, cached for its next block."""

    def __init__(self, streams: RandomStreams) -> None:
        self._streams = streams
        self._drawn: dict[str, tuple[int, Any]] = {}

    def of(self, purpose: str, tick: int, draw: Callable[[np.random.Generator], Drawn]) -> Drawn:
        """Return the numbers that `draw` gives for a purpose and the revolution at `tick`."""
        known = self._drawn.get(purpose)
        if known is None or known[0] != tick:
            known = self._drawn[purpose] = tick, draw(self._streams.at(purpose, tick))
        drawn: Drawn = known[1]
        return drawn
