# SPDX-License-Identifier: Apache-2.0
"""Standard normal numbers by the polar method, as in the paper (3.3.3), or by numpy's method.

The numbers depend on the generator's state alone, not on how many are drawn at a time.
"""

import math
from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

PAIRS_ACCEPTED = math.pi / 4
"""Share of points of the square [-1, 1)^2 that lie within the unit circle."""


class Normals(Protocol):
    """A source of standard normal numbers."""

    def draw(self, count: int) -> NDArray[np.float64]:
        """Return the next `count` numbers, float64, shape (count,)."""


class PolarNormal:
    """The polar method, on a generator of its own.

    Marsaglia and Bray (1964), "A convenient method for generating normal variables": a point (u, v)
    uniform in the unit disc gives u f and v f with f = sqrt(-2 ln(s) / s) and s = u^2 + v^2.
    """

    def __init__(self, generator: np.random.Generator) -> None:
        self._generator = generator
        self._spare = np.empty(0)

    def draw(self, count: int) -> NDArray[np.float64]:
        """Return the next `count` standard normal numbers, float64, shape (count,)."""
        drawn = [self._spare]
        missing = count - len(self._spare)
        while missing > 0:
            # A few more than needed on average, so that a second pass is rare.
            pairs = int(missing / (2 * PAIRS_ACCEPTED) * 1.1) + 8
            points = 2.0 * self._generator.random((pairs, 2)) - 1.0
            squares = points[:, 0] ** 2 + points[:, 1] ** 2
            inside = (squares < 1.0) & (squares > 0.0)
            points, squares = points[inside], squares[inside]
            drawn.append((points * np.sqrt(-2.0 * np.log(squares) / squares)[:, None]).ravel())
            missing -= len(drawn[-1])
        numbers = np.concatenate(drawn)
        self._spare = numbers[count:]
        return numbers[:count]


class ZigguratNormal:
    """Numpy's method, the ziggurat, on a generator of its own; three times as fast.

    Marsaglia and Tsang (2000), "The ziggurat method for generating random variables".
    """

    def __init__(self, generator: np.random.Generator) -> None:
        self._generator = generator

    def draw(self, count: int) -> NDArray[np.float64]:
        """Return the next `count` standard normal numbers, float64, shape (count,)."""
        return self._generator.standard_normal(count)


NORMALS: dict[str, Callable[[np.random.Generator], Normals]] = {
    "marsaglia": PolarNormal,
    "numpy": ZigguratNormal,
}
"""Sources of normal numbers by a scenario's `noise_source`."""
