# SPDX-License-Identifier: Apache-2.0
"""Random numbers of a revolution.

Every ray has its own numbers, whether it returns or not and whatever block it is in. So a hit does
not change another ray's noise, and blocks have the same numbers as the whole revolution.
"""

import ctypes
import math
from collections.abc import Callable
from ctypes import c_float, c_uint32
from functools import cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from services.sensors.noise.random_streams import RandomStreams
from services.sensors.rays.kernels import kernels
from services.sensors.rays.scene import Reals

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

    def normals(self, purpose: str, tick: int, shape: tuple[int, ...]) -> Reals:
        """Return standard normal numbers: those of `Generator.standard_normal` in float32.

        The array is overwritten by the numbers of the next revolution.
        """
        known = self._drawn.get(purpose)
        if known is None or known[0] != tick:
            numbers: Reals = np.empty(shape, np.float32) if known is None else known[1]
            words = np.array([*self._streams.key(purpose), tick, 0], np.uint64)
            kernels().groundlink_normals(
                *(ctypes.byref(_ziggurat()), words[:2].ctypes.data, words[2:].ctypes.data),
                *(numbers.size, numbers.ctypes.data),
            )
            known = self._drawn[purpose] = tick, numbers
        normals: Reals = known[1]
        return normals


LAYERS = 256


class _Ziggurat(ctypes.Structure):
    """The structure `ziggurat` of `normals.c`."""

    _fields_ = (
        ("inside", c_uint32 * LAYERS),
        *((name, c_float * LAYERS) for name in ("width", "height")),
        *((name, c_float) for name in ("right", "per_right")),
    )


@cache
def _ziggurat() -> _Ziggurat:
    """Return layers of the same area under exp(-x^2 / 2), as by Marsaglia and Tsang."""
    right, whole = 3.6541528853610088, 2.0**23
    beyond = math.sqrt(math.pi / 2) * math.erfc(right / math.sqrt(2))
    area = right * math.exp(-right * right / 2) + beyond
    # The lowest layer is a box with the tail; the others end where their lower edge is the curve.
    ends = [area / math.exp(-right * right / 2), right]
    while len(ends) < LAYERS:
        edge = area / ends[-1] + math.exp(-ends[-1] * ends[-1] / 2)
        ends.append(math.sqrt(-2 * math.log(edge)))
    layers = [0, *range(LAYERS - 1, 0, -1)]
    inner = [*ends[1:], 0.0]
    return _Ziggurat(
        (c_uint32 * LAYERS)(*(round(inner[layer] / ends[layer] * whole) for layer in layers)),
        (c_float * LAYERS)(*(ends[layer] / whole for layer in layers)),
        (c_float * LAYERS)(1.0, *(math.exp(-(ends[layer] ** 2) / 2) for layer in layers[1:])),
        *(right, 1 / right),
    )
