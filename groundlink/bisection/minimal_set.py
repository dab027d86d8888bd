# SPDX-License-Identifier: Apache-2.0
"""Smallest set of changes that makes a good run bad: delta debugging.

The algorithm is `ddmin` of Zeller and Hildebrandt, "Simplifying and Isolating Failure-Inducing
Input", IEEE Transactions on Software Engineering 28(2), 2002, section 3.
"""

from collections.abc import Callable, Sequence
from typing import TypeVar

T = TypeVar("T")


def minimal_set(changes: Sequence[T], is_bad: Callable[[tuple[T, ...]], bool]) -> tuple[T, ...]:
    """Return a smallest bad set: without any one of its changes it is not bad.

    No set is probed twice. For n changes it takes at most n^2 + 3n probes, and at most
    2 ceil(log2(n)) if a single change is to blame.

    Parameters
    ----------
    changes
        all of them together are bad, none of them is good.
    is_bad
        judges a set of changes, in their order; False also where it cannot be judged.
    """
    probed: dict[tuple[int, ...], bool] = {(): False, tuple(range(len(changes))): True}

    def probe(numbers: tuple[int, ...]) -> bool:
        if numbers not in probed:
            probed[numbers] = is_bad(tuple(changes[i] for i in numbers))
        return probed[numbers]

    kept, parts = tuple(range(len(changes))), 2
    while len(kept) > 1:
        subsets = [
            kept[len(kept) * i // parts : len(kept) * (i + 1) // parts] for i in range(parts)
        ]
        complements = [tuple(n for n in kept if n not in subset) for subset in subsets]
        if smaller := next(filter(probe, subsets), None):
            kept, parts = smaller, 2
        elif smaller := next(filter(probe, complements), None):
            kept, parts = smaller, max(parts - 1, 2)
        elif parts < len(kept):
            parts = min(2 * parts, len(kept))
        else:
            break
    return tuple(changes[i] for i in kept)
