# SPDX-License-Identifier: Apache-2.0
"""Shrinking keeps what the failure needs, and no more."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundlink.search.shrinking import HALVINGS, shrunk
from groundlink.search.space import Point, space

SPACE = space(["a.x=0.0..10.0", "a.y=0.0..10.0", "a.n=0..100", "a.z=red,green,blue"])
ORIGIN: dict[str, Any] = {"a.x": 1.0, "a.y": 2.0, "a.n": 0, "a.z": "red"}
FAILING: Point = {"a.x": 9.0, "a.y": 8.0, "a.n": 77, "a.z": "blue"}


@pytest.mark.parametrize(
    ("needed", "least"),
    [
        ({"a.x": 4.0}, {"a.x": (4.0, 4.25)}),
        ({"a.n": 50}, {"a.n": (50, 51)}),
        ({"a.z": "blue"}, {"a.z": ("blue", "blue")}),
        ({"a.x": 9.0, "a.y": 8.0}, {"a.x": (9.0, 9.0), "a.y": (8.0, 8.0)}),
        ({"a.x": 2.0, "a.z": "blue"}, {"a.x": (2.0, 2.25), "a.z": ("blue", "blue")}),
    ],
)
def test_only_what_is_needed_remains(needed: Point, least: dict[str, tuple[Any, Any]]) -> None:
    def fails(point: Point) -> bool:
        full = ORIGIN | point
        return all(
            full[name] == value if isinstance(value, str) else full[name] >= value
            for name, value in needed.items()
        )

    point = shrunk(FAILING, ORIGIN, SPACE, fails)
    assert point.keys() == least.keys()
    for name, (low, high) in least.items():
        assert low <= point[name] <= high


def test_field_with_the_value_of_the_scenario_is_left_out_without_a_run() -> None:
    asked: list[Point] = []

    def fails(point: Point) -> bool:
        asked.append(point)
        return "a.z" in point

    assert shrunk({"a.x": 1.0, "a.z": "blue"}, ORIGIN, SPACE, fails) == {"a.z": "blue"}
    assert asked == []


@given(st.sets(st.tuples(*[st.booleans()] * 4)), st.data())
def test_result_fails_whatever_fails(sets: set[tuple[bool, ...]], data: st.DataObject) -> None:
    """Failures that depend on the set of changed fields in any way."""
    everything = (True,) * 4
    asked: list[Point] = []

    def fails(point: Point) -> bool:
        asked.append(point)
        changed = tuple(field.name in point for field in SPACE.fields)
        return changed == everything or changed in sets

    point = shrunk(FAILING, ORIGIN, SPACE, fails)
    assert fails(point)
    for name in point:
        rest = {other: value for other, value in point.items() if other != name}
        assert not rest or not fails(rest), "each field that remains is needed"
    assert len(asked) <= 4 * 5 * 2 + 4 * HALVINGS
