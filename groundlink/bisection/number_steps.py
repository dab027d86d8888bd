# SPDX-License-Identifier: Apache-2.0
"""Numbers from a good one to a bad one, in equal steps and without rounding errors."""

import math
from decimal import Decimal

DEFAULT_STEPS = 100
"""Steps between two numbers of which one is no integer."""


class NumberSteps:
    """The numbers from `good` to `bad`, both included, as a sequence.

    Parameters
    ----------
    good, bad
        different numbers; either may be the larger one.
    resolution
        step; None: 1 between integers, else a hundredth of the difference. The last step may be
        smaller.

    Raises
    ------
    ValueError
        for a resolution that is not more than 0 or not finite.
    """

    def __init__(self, good: float, bad: float, resolution: float | None = None) -> None:
        self._good, self._bad = (Decimal(repr(number)) for number in (good, bad))
        difference = self._bad - self._good
        if resolution is None:
            are_integers = isinstance(good, int) and isinstance(bad, int)
            step = Decimal(1) if are_integers else abs(difference) / DEFAULT_STEPS
        else:
            if not 0 < resolution < math.inf:
                raise ValueError("a step is more than 0, and finite")
            step = Decimal(repr(resolution))
        self._step = step.copy_sign(difference)
        self._count = 1 + math.ceil(difference / self._step)
        self._type = int if all(isinstance(n, int) for n in (good, bad)) and not step % 1 else float

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, number: int) -> float:
        if not 0 <= number < self._count:
            raise IndexError(number)
        is_last = number == self._count - 1
        return self._type(self._bad if is_last else self._good + number * self._step)
