# SPDX-License-Identifier: Apache-2.0
"""The first bad candidate is found in a line and in a graph, with few probes and none twice."""

import math
from collections.abc import Callable, Iterator, Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundlink.bisection.search import Flip, NumberLine, RunVerdict, first_bad, most_probes

LINES = st.integers(2, 300).flatmap(lambda n: st.tuples(st.just(n), st.integers(1, n - 1)))
"""Number of candidates, and the first bad one."""


def searched(n: int, judge: Callable[[int], RunVerdict]) -> tuple[Flip[int], list[int]]:
    """Return what is found in a line, and the probes."""
    probes: list[int] = []

    def probe(candidate: int) -> RunVerdict:
        probes.append(candidate)
        return judge(candidate)

    return first_bad(NumberLine(), 0, n - 1, probe), probes


@given(LINES)
def test_first_bad_one_of_a_line_is_found_in_log2_probes(line: tuple[int, int]) -> None:
    n, first = line
    flip, probes = searched(n, lambda i: RunVerdict.BAD if i >= first else RunVerdict.GOOD)
    assert (max(flip.good), flip.bad, flip.skipped) == (first - 1, first, ())
    assert len(set(probes)) == len(probes) <= math.ceil(math.log2(n - 1))
    assert len(probes) + 2 <= most_probes(n)


@given(st.lists(st.sampled_from(RunVerdict), max_size=60))
def test_some_flip_is_found_whatever_the_verdicts_are(inner: list[RunVerdict]) -> None:
    verdicts = [RunVerdict.GOOD, *inner, RunVerdict.BAD]
    flip, probes = searched(len(verdicts), verdicts.__getitem__)
    assert len(set(probes)) == len(probes)
    last_good = max(flip.good)
    assert (verdicts[last_good], verdicts[flip.bad]) == (RunVerdict.GOOD, RunVerdict.BAD)
    between = range(last_good + 1, flip.bad)
    assert sorted(flip.skipped) == [*between]
    assert all(verdicts[i] is RunVerdict.SKIPPED for i in between)


class Graph:
    """Commits with their parents; all descendants of the guilty one are bad."""

    def __init__(self, parents: Sequence[Sequence[int]]) -> None:
        self._parents = parents

    def history(self, commit: int) -> set[int]:
        """Return a commit with all its ancestors."""
        return {commit}.union(*map(self.history, self._parents[commit]))

    def between(self, good: Sequence[int], bad: int) -> Iterator[int]:
        known = set().union(*map(self.history, good))
        open_ = self.history(bad) - known
        halves = {c: abs(len(self.history(c) - known) - len(open_) / 2) for c in open_ - {bad}}
        yield from sorted(halves, key=lambda commit: (halves[commit], commit))


@pytest.mark.parametrize("guilty", range(1, 9))
def test_guilty_commit_of_a_branch_is_found(guilty: int) -> None:
    graph = Graph([[], [0], [1], [1], [3], [2, 4], [5], [6], [7]])
    probes = []

    def probe(commit: int) -> RunVerdict:
        probes.append(commit)
        return RunVerdict.BAD if guilty in graph.history(commit) else RunVerdict.GOOD

    flip = first_bad(graph, 0, 8, probe)
    assert flip.bad == guilty
    assert len(probes) <= 4


@pytest.mark.parametrize(("n", "most"), [(2, 2), (3, 3), (4, 4), (5, 4), (17, 6), (18, 7)])
def test_most_probes_include_both_ends(n: int, most: int) -> None:
    assert most_probes(n) == most
