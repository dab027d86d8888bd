# SPDX-License-Identifier: Apache-2.0
"""Samplers: choose the next point of a search, evenly spread or by the objective so far.

No point is chosen twice. The same seed and results give the same points.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import TYPE_CHECKING, Protocol

import numpy as np

from groundlink.core.extras import needs

from .space import NumberRange, Point, Space, VariedField

if TYPE_CHECKING:
    from optuna.distributions import BaseDistribution

FIRST = 10
"""Points that are spread evenly before the objective guides the choice."""

REPETITIONS = 20
"""After this many proposals of known points, a point is taken from those that spread evenly."""

Indices = tuple[int, ...]


class Sampler(Protocol):
    """Chooses points, and receives their objectives in the same order."""

    def ask(self) -> Point | None:
        """Return the next point, None if all were chosen."""

    def tell(self, objective: float | None) -> None:
        """Receive the result of the earliest point without one; None: it has none."""


class EvenSampler:
    """Spreads points evenly over the space, whatever their results are.

    The sequence is that of A. Owen, "A randomized Halton algorithm in R" (2017): any number of its
    first points fills the range of each field without large gaps.
    """

    def __init__(self, space: Space, seed: int) -> None:
        self._space = space
        self._chosen: set[Indices] = set()
        self._sequence = _even_indices(space, seed)

    def ask(self) -> Point | None:
        """Return the next point of the sequence that was not chosen before."""
        indices = self.next_indices()
        return None if indices is None else self._space.point(indices)

    def next_indices(self) -> Indices | None:
        """Choose the next point; return its indices, None if all were chosen."""
        if len(self._chosen) == self._space.size:
            return None
        chosen = next(each for each in self._sequence if each not in self._chosen)
        self._chosen.add(chosen)
        return chosen

    def choose(self, indices: Indices) -> bool:
        """Mark a point as chosen; return whether it was not before."""
        is_new = indices not in self._chosen
        self._chosen.add(indices)
        return is_new

    def tell(self, objective: float | None) -> None:
        """Ignore a result."""


class OptunaSampler:
    """Looks for a small or large objective by Optuna's tree-structured Parzen estimator.

    Bergstra et al., "Algorithms for Hyper-Parameter Optimization", NIPS 2011.
    """

    def __init__(self, space: Space, seed: int, *, maximize: bool) -> None:
        with needs("search"):
            import optuna
        optuna.logging.set_verbosity(optuna.logging.ERROR)
        self._space = space
        self._even = EvenSampler(space, seed)
        self._failed = optuna.trial.TrialState.FAIL
        self._study = optuna.create_study(
            sampler=optuna.samplers.TPESampler(seed=seed, n_startup_trials=FIRST),
            direction="maximize" if maximize else "minimize",
        )
        self._distributions = {field.name: _distribution(field) for field in space.fields}
        self._asked: list[optuna.trial.Trial] = []
        self._told = 0

    def ask(self) -> Point | None:
        """Return the next point: spread evenly at first, then chosen by the results."""
        if len(self._asked) >= FIRST:
            for _ in range(REPETITIONS):
                trial = self._study.ask(self._distributions)
                indices = tuple(trial.params[field.name] for field in self._space.fields)
                if self._even.choose(indices):
                    self._asked.append(trial)
                    return self._space.point(indices)
                self._study.tell(trial, state=self._failed)
        if (even := self._even.next_indices()) is None:
            return None
        names = (field.name for field in self._space.fields)
        self._study.enqueue_trial(dict(zip(names, even, strict=True)))
        self._asked.append(self._study.ask(self._distributions))
        return self._space.point(even)

    def tell(self, objective: float | None) -> None:
        """Receive the objective of the earliest point without one."""
        trial = self._asked[self._told]
        self._told += 1
        if objective is None:
            self._study.tell(trial, state=self._failed)
        else:
            self._study.tell(trial, objective)


def _distribution(field: VariedField) -> BaseDistribution:
    import optuna

    if isinstance(field, NumberRange):
        return optuna.distributions.IntDistribution(0, field.count - 1)
    return optuna.distributions.CategoricalDistribution(range(field.count))


def _even_indices(space: Space, seed: int) -> Iterator[Indices]:
    """Yield the indices of a sequence that fills the space evenly."""
    counts = np.array([field.count for field in space.fields])
    generator = np.random.default_rng(seed)
    sequences = [_HaltonSequence(base, generator) for base in _primes(len(counts))]
    for number in itertools.count():
        shares = np.array([sequence.at(number) for sequence in sequences])
        yield tuple((shares * counts).astype(int).tolist())


class _HaltonSequence:
    """Halton's sequence of a prime base with random permutations of the digits, below 1."""

    def __init__(self, base: int, generator: np.random.Generator) -> None:
        self._base = base
        digits = int(np.log(2.0**32) / np.log(base))
        self._digits = [generator.permutation(base).tolist() for _ in range(digits)]

    def at(self, number: int) -> float:
        """Return an element, 0 or more and below 1."""
        share, place = 0.0, 1.0
        for permuted in self._digits:
            number, digit = divmod(number, self._base)
            place /= self._base
            share += permuted[digit] * place
        return share


def _primes(count: int) -> Iterator[int]:
    """Yield the first prime numbers."""
    numbers = (n for n in itertools.count(2) if all(n % d for d in range(2, n)))
    return itertools.islice(numbers, count)
