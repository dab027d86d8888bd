# SPDX-License-Identifier: Apache-2.0
"""Delta debugging finds a set of changes of which each is needed."""

import math

from hypothesis import given
from hypothesis import strategies as st

from groundlink.bisection.minimal_set import minimal_set

Sets = list[tuple[int, ...]]

CULPRITS = st.integers(1, 24).flatmap(
    lambda n: st.tuples(st.just(n), st.sets(st.integers(0, n - 1), min_size=1))
)
"""Number of changes, and those that are bad together."""


def searched(n: int, culprits: set[int]) -> tuple[tuple[int, ...], Sets]:
    """Return the set that is found, and the probes."""
    probes: Sets = []

    def is_bad(changes: tuple[int, ...]) -> bool:
        probes.append(changes)
        return culprits <= {*changes}

    return minimal_set(range(n), is_bad), probes


@given(CULPRITS)
def test_exactly_the_culprits_are_found(case: tuple[int, set[int]]) -> None:
    n, culprits = case
    found, probes = searched(n, culprits)
    assert found == tuple(sorted(culprits))
    assert len({*probes}) == len(probes) <= n * n + 3 * n
    assert () not in probes
    assert tuple(range(n)) not in probes, "its verdict is known"


@given(st.integers(1, 300).flatmap(lambda n: st.tuples(st.just(n), st.integers(0, n - 1))))
def test_single_culprit_takes_few_probes(case: tuple[int, int]) -> None:
    n, culprit = case
    found, probes = searched(n, {culprit})
    assert found == (culprit,)
    assert len(probes) <= 2 * math.ceil(math.log2(n))


@given(st.integers(1, 7).flatmap(lambda n: st.lists(st.booleans(), min_size=2**n, max_size=2**n)))
def test_no_change_can_be_left_out_whatever_the_verdicts_are(verdicts: list[bool]) -> None:
    n = len(verdicts).bit_length() - 1
    verdicts[0], verdicts[-1] = False, True
    is_bad = {
        tuple(i for i in range(n) if number >> i & 1): bad for number, bad in enumerate(verdicts)
    }
    found = minimal_set(range(n), is_bad.__getitem__)
    assert is_bad[found]
    assert not any(is_bad[tuple(i for i in found if i != left_out)] for left_out in found)
