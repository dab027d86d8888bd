# SPDX-License-Identifier: Apache-2.0
"""Numbers between two values are exact, and end with both values."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundlink.bisection.number_steps import NumberSteps


@pytest.mark.parametrize(
    ("good", "bad", "resolution", "numbers"),
    [
        (0.5, 0.8, 0.1, [0.5, 0.6, 0.7, 0.8]),
        (0.8, 0.5, 0.1, [0.8, 0.7, 0.6, 0.5]),
        (1, 4, None, [1, 2, 3, 4]),
        (0, 5, 2, [0, 2, 4, 5]),
        (0, 1, 0.5, [0.0, 0.5, 1.0]),
        (-1.0, 1.0, 3.0, [-1.0, 1.0]),
    ],
)
def test_steps(good: float, bad: float, resolution: float | None, numbers: list[float]) -> None:
    steps = NumberSteps(good, bad, resolution)
    found = [steps[i] for i in range(len(steps))]
    assert found == numbers
    assert {type(number) for number in found} == {type(numbers[0])}


def test_hundred_steps_without_a_resolution() -> None:
    steps = NumberSteps(0.5, 1.5)
    assert len(steps) == 101
    assert (steps[1], steps[35]) == (0.51, 0.85)


@given(*[st.floats(-1e6, 1e6, allow_nan=False) for _ in range(2)], st.floats(1e-3, 1e6))
def test_each_step_is_between_its_neighbors(good: float, bad: float, resolution: float) -> None:
    if good == bad:
        return
    steps = NumberSteps(good, bad, resolution)
    sign = 1 if bad > good else -1
    numbers = [steps[i] for i in {0, 1, len(steps) // 2, len(steps) - 2, len(steps) - 1}]
    numbers.sort(reverse=sign < 0)
    assert numbers[0] == good
    assert numbers[-1] == bad


@pytest.mark.parametrize("resolution", [0.0, -1.0, float("nan"), float("inf")])
def test_resolution_is_more_than_zero(resolution: float) -> None:
    with pytest.raises(ValueError, match="more than 0"):
        NumberSteps(0.0, 1.0, resolution)


@pytest.mark.parametrize("number", [-1, 2])
def test_there_is_no_number_beyond_the_ends(number: int) -> None:
    with pytest.raises(IndexError):
        NumberSteps(0, 1)[number]
