# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from udp_bridge.receiver.delivery_log import REMEMBERED, Fates

STARTS = st.sampled_from([0, 5, 2**31 - 10, 2**32 - 10])


def missing(fates: Fates) -> int:
    known = fates.handed + fates.incomplete + fates.late + fates.open_count
    return fates.numbers - known


def counts(fates: Fates) -> tuple[int, ...]:
    return fates.numbers, fates.handed, fates.incomplete, fates.late, missing(fates)


@pytest.mark.parametrize("start", [0, 2**32 - 2])
def test_gaps_are_missing_until_they_get_a_fate(start: int) -> None:
    fates = Fates()
    fates.settle(start, "handed")
    fates.seen((start + 4) % 2**32)
    assert (*counts(fates), fates.open_count) == (5, 1, 0, 0, 3, 1)
    assert fates.first_number == start
    fates.settle((start + 2) % 2**32, "late")
    fates.settle((start + 4) % 2**32, "incomplete")
    assert (*counts(fates), fates.open_count) == (5, 1, 1, 1, 2, 0)


def test_a_second_fate_does_not_count() -> None:
    fates = Fates()
    assert fates.settle(3, "handed")
    assert not fates.settle(3, "late")
    assert counts(fates) == (1, 1, 0, 0, 0)


def test_what_was_overtaken_at_the_very_begin_counts() -> None:
    fates = Fates()
    fates.settle(5, "handed")
    fates.settle(3, "late")
    assert (fates.first_number, *counts(fates)) == (3, 3, 1, 0, 1, 1)


def test_what_is_too_old_keeps_its_fate() -> None:
    fates = Fates()
    fates.settle(0, "handed")
    fates.settle(REMEMBERED + 1, "handed")
    assert not fates.settle(0, "late")
    assert not fates.settle(1, "late")
    assert fates.settle(2, "late")
    assert counts(fates) == (REMEMBERED + 2, 2, 0, 1, REMEMBERED - 1)


def test_a_forged_jump_takes_no_memory() -> None:
    fates = Fates()
    fates.settle(0, "handed")
    fates.seen(2**31 - 1)
    assert fates._came.bit_length() <= REMEMBERED
    assert counts(fates)[0] == 2**31


def test_only_what_was_mended_and_handed_over_is_repaired() -> None:
    fates = Fates()
    fates.settle(0, "handed")
    for number, fate in ((1, "handed"), (2, "incomplete"), (3, "late")):
        fates.mended(number)
        fates.settle(number, fate)
    assert fates.repaired == 1


@given(
    STARTS,
    st.lists(
        st.tuples(st.integers(0, 60), st.sampled_from(["seen", "handed", "incomplete", "late"]))
    ),
)
def test_every_number_has_one_fate(start: int, steps: list[tuple[int, str]]) -> None:
    fates = Fates()
    model: dict[int, str] = {}
    first = None
    for offset, what in steps:
        number = (start + offset) % 2**32
        first = offset if first is None else first
        if what == "seen":
            fates.seen(number)
        else:
            fates.settle(number, what)
        first = min(first, offset)
        if model.get(offset, "seen") == "seen":
            model[offset] = what
    fated = list(model.values())
    numbers = max(model) - first + 1 if first is not None else 0
    assert (*counts(fates), fates.open_count) == (
        numbers,
        *(fated.count(fate) for fate in ("handed", "incomplete", "late")),
        numbers - len(model),
        fated.count("seen"),
    )
