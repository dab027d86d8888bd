# SPDX-License-Identifier: Apache-2.0
"""Coverage counts points by bin."""

from groundlink.search.coverage import coverage
from groundlink.search.space import varied_field


def test_points_are_counted_in_bins() -> None:
    field = varied_field("a.x=0.0..10.0")
    points = [{"a.x": 0.0}, {"a.x": 0.9}, {"a.x": 5.0}, {"a.x": 10.0}, {"a.x": 11.0}, {"b": 1}]
    covered = coverage(field, points)
    assert covered.counts == (2, 0, 0, 0, 0, 1, 0, 0, 0, 1)
    assert covered.visited == 3
    assert covered.share == 0.3
    assert list(field.bins) == ["0", "1", "2", "3", "4", "5", "6", "7", "8", "9"]


def test_values_of_a_list_are_bins() -> None:
    covered = coverage(varied_field("a.z=red,green"), [{"a.z": "green"}, {"a.z": "blue"}])
    assert covered.counts == (0, 1)
    assert covered.share == 0.5
