# SPDX-License-Identifier: Apache-2.0
"""Table of the points of a search as Parquet and CSV: a row for each point."""

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from groundlink.core.atomic_file import write_atomically
from groundlink.search.point_journal import PointRow

PARQUET, CSV = "points.parquet", "points.csv"


def write_point_table(folder: Path, rows: Sequence[PointRow]) -> None:
    """Write both files, replacing existing ones.

    Columns are `stage`, `number`, the varied fields, `verdict`, `text`, `objective` and the key
    figures. A cell is empty where a point has no such value.

    Raises
    ------
    UserError
        if a file cannot be written.
    """
    import pyarrow
    from pyarrow import parquet

    columns = point_columns(rows)
    with write_atomically(folder / PARQUET) as part:
        parquet.write_table(pyarrow.table(columns), part)
    with (
        write_atomically(folder / CSV) as part,
        part.open("w", newline="", encoding="utf-8") as opened,
    ):
        writer = csv.writer(opened, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))


def point_columns(rows: Sequence[PointRow]) -> dict[str, list[Any]]:
    """Return the columns by name; None where a point has no value."""
    varied = dict.fromkeys(name for row in rows for name in row.values)
    figures = dict.fromkeys(name for row in rows for name in row.outcome.figures)
    return {
        "stage": [row.stage for row in rows],
        "number": [row.number for row in rows],
        **{name: _uniform([row.values.get(name) for row in rows]) for name in varied},
        "verdict": [row.outcome.verdict for row in rows],
        "text": [row.outcome.text for row in rows],
        "objective": [row.outcome.objective for row in rows],
        **{name: [row.outcome.figures.get(name) for row in rows] for name in figures},
    }


def _uniform(values: list[Any]) -> list[Any]:
    """Return values of one type: numbers, truth values or text, otherwise JSON of each."""
    stated = [value for value in values if value is not None]
    kinds = {bool if isinstance(value, bool) else type(value) for value in stated}
    if kinds == {int, float}:
        return [None if value is None else float(value) for value in values]
    if len(kinds) <= 1 and kinds <= {bool, int, float, str}:
        return values
    return [None if value is None else json.dumps(value) for value in values]
