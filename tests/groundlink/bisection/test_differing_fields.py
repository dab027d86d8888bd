# SPDX-License-Identifier: Apache-2.0
"""The smallest differing fields of two documents."""

from typing import Any

import pytest

from groundlink.bisection.differing_fields import FieldPath, differing_fields


@pytest.mark.parametrize(
    ("good", "bad", "fields"),
    [
        ({"seed": 1}, {"seed": 1}, {}),
        ({"seed": 1, "name": "a"}, {"seed": 2, "name": "a"}, {("seed",): 2}),
        ({"time": {"mode": "fast", "rate": 1}}, {"time": {"mode": "fast"}}, {("time", "rate"): 0}),
        ({}, {"weather": {"rain": 1}}, {("weather",): {"rain": 1}}),
        (
            {"sensors": [{"name": "a", "hz": 1}, {"name": "b", "hz": 1}]},
            {"sensors": [{"name": "a", "hz": 1}, {"name": "b", "hz": 2}]},
            {("sensors", 1, "hz"): 2},
        ),
        (
            {"sensors": [{"name": "a"}]},
            {"sensors": [{"name": "a"}, {"name": "b"}]},
            {("sensors",): [{"name": "a"}, {"name": "b"}]},
        ),
        ({"xyz": [0, 1]}, {"xyz": [0, 2]}, {("xyz",): [0, 2]}),
        ({"world": "lab"}, {"world": {"kind": "flat"}}, {("world",): {"kind": "flat"}}),
        (
            {"route": {"kind": "line", "v": 1}},
            {"route": {"kind": "circle", "v": 1}},
            {("route",): {"kind": "circle", "v": 1}},
        ),
    ],
)
def test_fields(good: Any, bad: Any, fields: dict[FieldPath, Any]) -> None:
    assert dict(differing_fields(good, bad, absent=lambda path: 0)) == fields
