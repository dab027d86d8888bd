# SPDX-License-Identifier: Apache-2.0
"""Search of the first bad candidate between a good and a bad one: half of them at each probe.

The order of candidates is an argument, since values of a field stand in a line, and commits in a
graph with merges.
"""

import enum
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

T = TypeVar("T")


class RunVerdict(enum.Enum):
    """Result of a probe."""

    GOOD = "good"
    BAD = "bad"
    SKIPPED = "skipped"
    """The candidate cannot be judged."""


class CandidateOrder(Protocol[T]):
    """Order in which candidates become bad."""

    def between(self, good: Sequence[T], bad: T) -> Iterable[T]:
        """Return the open candidates, the one that halves them best first.

        Parameters
        ----------
        good
            the candidates found to be good, in the order of their probes.
        bad
            the earliest candidate found to be bad, which is not returned.
        """


class NumberLine:
    """Order of the numbers 0, 1, 2, ...: all before the first bad one are good."""

    def between(self, good: Sequence[int], bad: int) -> Iterator[int]:
        """Yield the numbers between the largest good one and the bad one, the middle first."""
        low = max(good)
        middle = (low + bad) // 2
        for distance in range(bad - low):
            for number in dict.fromkeys((middle + distance, middle - distance)):
                if low < number < bad:
                    yield number


@dataclass(frozen=True)
class Flip(Generic[T]):
    """Where good becomes bad."""

    good: tuple[T, ...]
    """All candidates found to be good, in the order of their probes."""

    bad: T
    """The earliest candidate found to be bad."""

    skipped: tuple[T, ...]
    """Candidates that may be the first bad one as well, since they could not be judged."""


def first_bad(
    order: CandidateOrder[T], good: T, bad: T, probe: Callable[[T], RunVerdict]
) -> Flip[T]:
    """Find where good becomes bad; no candidate is probed twice.

    In a line of n candidates, `good` and `bad` included, it takes at most ceil(log2(n - 1)) probes
    if none is skipped. If candidates turn from good to bad several times, one of these flips is
    found.

    Parameters
    ----------
    good, bad
        candidates with a known verdict.
    probe
        judges a candidate.
    """
    known_good = [good]
    skipped: set[T] = set()
    while True:
        candidates = order.between(known_good, bad)
        candidate = next((each for each in candidates if each not in skipped), None)
        if candidate is None:
            left = tuple(order.between(known_good, bad))
            return Flip(tuple(known_good), bad, left)
        match probe(candidate):
            case RunVerdict.GOOD:
                known_good.append(candidate)
            case RunVerdict.BAD:
                bad = candidate
            case RunVerdict.SKIPPED:
                skipped.add(candidate)


def most_probes(candidates: int) -> int:
    """Return the most probes of `first_bad` in a line, those of both ends included."""
    return 2 + (candidates - 2).bit_length()
