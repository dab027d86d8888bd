# SPDX-License-Identifier: Apache-2.0
"""Points as Parquet and CSV have the same rows; columns have one type."""

import csv
from pathlib import Path

from pyarrow import parquet

from groundlink.data.point_table import write_point_table
from groundlink.search.point_journal import PointOutcome, PointRow


def test_both_files_have_a_row_for_each_point(tmp_path: Path) -> None:
    rows = [
        PointRow(
            "scenario",
            1,
            {"a": 1, "b": "x", "c": {"d": 1}, "e": True},
            PointOutcome("passed", "é,\n"),
        ),
        PointRow(
            "search",
            1,
            {"a": 0.5, "b": 2, "c": [1], "e": None},
            PointOutcome("failed", "-", 2.5, {"driven m": 1.25}),
        ),
    ]
    for _ in range(2):  # the second time replaces the files
        write_point_table(tmp_path, rows)
    table = parquet.read_table(tmp_path / "points.parquet").to_pylist()
    assert table == [
        {
            "stage": "scenario",
            "number": 1,
            "a": 1.0,
            "b": '"x"',
            "c": '{"d": 1}',
            "e": True,
            "verdict": "passed",
            "text": "é,\n",
            "objective": None,
            "driven m": None,
        },
        {
            "stage": "search",
            "number": 1,
            "a": 0.5,
            "b": "2",
            "c": "[1]",
            "e": None,
            "verdict": "failed",
            "text": "-",
            "objective": 2.5,
            "driven m": 1.25,
        },
    ]
    with (tmp_path / "points.csv").open(newline="", encoding="utf-8") as opened:
        read = list(csv.DictReader(opened))
    assert [row["text"] for row in read] == ["é,\n", "-"]
    assert [row["objective"] for row in read] == ["", "2.5"]
    assert sorted(file.name for file in tmp_path.iterdir()) == ["points.csv", "points.parquet"]
