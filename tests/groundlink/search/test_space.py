# SPDX-License-Identifier: Apache-2.0
"""Arguments of `--vary` become grids and lists; values have bins and middles."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundlink.core.errors import UserError
from groundlink.search.space import NumberRange, nearness, point_text, space, varied_field


@pytest.mark.parametrize(
    ("text", "count", "first", "second", "last"),
    [
        ("lidar.dropout=0.0..0.5", 5001, 0.0, 0.0001, 0.5),
        ("route.speed_mps=0.2..1.5", 1301, 0.2, 0.201, 1.5),
        ("route.speed_mps=0.3..1.4/0.1", 12, 0.3, 0.4, 1.4),
        ("a.b=0..9/5", 3, 0, 5, 9),
        ("seed=1..100", 100, 1, 2, 100),
        ("a.b=-2..3", 6, -2, -1, 3),
        ("a.b=0.0..1000.5", 1002, 0.0, 1.0, 1000.5),
        ("a.b=1e-5..2e-5", 1001, 1e-5, 1.001e-5, 2e-5),
        ("lidar.datasheet=vlp16,vlp32c,os1", 3, "vlp16", "vlp32c", "os1"),
        ("a.b=../one.yaml,../two.yaml", 2, "../one.yaml", "../two.yaml", "../two.yaml"),
        ("a.b={c: 1},null", 2, {"c": 1}, None, None),
    ],
)
def test_values_of_a_field(
    text: str, count: int, first: object, second: object, last: object
) -> None:
    field = varied_field(text)
    assert field.count == count
    values = [field.value(index) for index in (0, 1, count - 1)]
    assert values == [first, second, last]
    assert [type(value) for value in values] == [type(each) for each in (first, second, last)]
    assert varied_field(str(field)) == field or not isinstance(field, NumberRange)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("lidar.dropout", "expected FIELD=LOW..HIGH, FIELD=LOW..HIGH/STEP or FIELD=VALUE"),
        ("=1,2", "expected FIELD=LOW..HIGH"),
        ("lidar..dropout=1,2", "expected FIELD=LOW..HIGH"),
        ("lidar.dropout=0.5", "one value; expected"),
        ("lidar.dropout=0.5..0.1", "LOW below HIGH"),
        ("lidar.dropout=0.1..0.5/0", "step 0; expected more than 0"),
        ("lidar.dropout=0.1..0.5/1", "step 1; expected more than 0"),
        ("seed=1,2,1", "a value stands twice"),
    ],
)
def test_other_forms_are_refused_with_one_line(text: str, line: str) -> None:
    with pytest.raises(UserError, match=line.replace("..", r"\.\.")) as error:
        varied_field(text)
    assert f"--vary {text}" in str(error.value)


def test_field_given_twice_is_refused() -> None:
    with pytest.raises(UserError, match="--vary seed: given twice"):
        space(["seed=1,2", "lidar.dropout=0,1", "seed=3..5"])


ENDS = st.tuples(st.integers(-10_000, 10_000), st.integers(1, 10_000), st.integers(0, 3))


@given(ENDS, st.data())
def test_every_value_of_a_range_is_within_it_and_in_one_bin(
    ends: tuple[int, int, int], data: st.DataObject
) -> None:
    low, width, digits = ends
    scale = 10**digits
    text = f"a.b={low / scale:.{digits}f}..{(low + width) / scale:.{digits}f}"
    field = varied_field(text)
    index = data.draw(st.integers(0, field.count - 1))
    value = field.value(index)
    assert low / scale <= value <= (low + width) / scale
    where = field.bin_of(value)
    assert where is not None
    assert 0 <= where < len(field.bins) <= 10
    assert len(repr(value)) <= 12
    assert field.bin_of(field.value(0)) == 0
    assert field.bin_of(field.value(field.count - 1)) == len(field.bins) - 1


@given(st.integers(0, 1300), st.floats(-3, 3))
def test_middle_is_strictly_between(index: int, passing: float) -> None:
    field = varied_field("route.speed_mps=0.2..1.5")
    failing = field.value(index)
    middle = field.between(passing, failing)
    if middle is None:
        assert abs(passing - failing) <= 0.002
    else:
        assert min(passing, failing) < middle < max(passing, failing)
        assert abs(middle - (passing + failing) / 2) <= 0.0005 + 1e-9


def test_what_is_no_number_has_no_middle() -> None:
    field = varied_field("a.b=0.0..1.0")
    assert field.between(None, 0.5) is None
    assert field.between(True, 0.5) is None
    assert field.bin_of("x") is None
    assert field.bin_of(2.0) is None
    assert math.isnan(field.position(None))
    listed = varied_field("a.b=1,2")
    assert listed.between(1, 2) is None
    assert listed.bin_of(3) is None
    assert math.isnan(listed.position(3))


def test_nearest_point_has_the_fewest_and_smallest_changes() -> None:
    whole = space(["a.b=0.0..10.0", "a.c=x,y"])
    origin = {"a.b": 0.0, "a.c": "x"}
    points = [
        {"a.b": 1.0, "a.c": "y"},
        {"a.b": 9.0, "a.c": "x"},
        {"a.b": 5.0, "a.c": "x"},
        {"a.b": 0.0, "a.c": "y"},
    ]
    ordered = sorted(points, key=lambda point: nearness(point, origin, whole))
    assert ordered == [points[3], points[2], points[1], points[0]]
    assert point_text(points[0]) == "a.b=1.0, a.c=y"
