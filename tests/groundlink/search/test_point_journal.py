# SPDX-License-Identifier: Apache-2.0
"""A journal keeps complete lines, belongs to one command line, and to one process at a time."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundlink.core.errors import UserError
from groundlink.search.point_journal import PointJournal, PointOutcome, PointRow

IDENTITY = {"--seed": 1, "--vary": ["seed=1..5"]}


def row(number: int, stage: str = "search") -> PointRow:
    outcome = PointOutcome("failed", "é\n", 0.5, {"driven m": 1.5})
    return PointRow(stage, number, {"a.x": number / 10, "a.z": {"b": [1]}}, outcome)


def journal(folder: Path, identity: dict[str, object] | None = None) -> PointJournal:
    return PointJournal(folder / "journal.jsonl", identity or IDENTITY)


def test_rows_are_read_back(tmp_path: Path) -> None:
    first = journal(tmp_path)
    rows = [row(3), row(1), row(2), row(9, "shrink")]
    for each in rows:
        first.add(each)
    assert first.outcome({"a.z": {"b": [1]}, "a.x": 0.1}) == rows[1].outcome
    assert first.outcome({"a.x": 0.1}) is None
    first.close()
    second = journal(tmp_path)
    assert second.rows == [rows[1], rows[2], rows[0], rows[3]]
    second.close()


def test_other_command_line_is_refused_with_one_line(tmp_path: Path) -> None:
    journal(tmp_path).close()
    with pytest.raises(UserError, match=r"--seed is 1, expected 2\. Fix: repeat") as error:
        journal(tmp_path, IDENTITY | {"--seed": 2})
    assert "\n" not in str(error.value)


def test_journal_in_use_is_refused(tmp_path: Path) -> None:
    first = journal(tmp_path)
    with pytest.raises(UserError, match="in use by another process"):
        journal(tmp_path)
    first.close()
    journal(tmp_path).close()


@given(data=st.data())
def test_killed_writer_leaves_complete_rows(
    data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("journal")
    first = journal(folder)
    for number in range(3):
        first.add(row(number))
    first.close()
    file = folder / "journal.jsonl"
    whole = file.read_bytes()
    size = data.draw(st.integers(0, len(whole)))
    file.write_bytes(whole[:size])
    second = journal(folder)
    kept = second.rows
    assert kept == [row(number) for number in range(len(kept))]
    assert len(kept) == max(whole[:size].count(b"\n") - 1, 0)
    second.add(row(7))
    second.close()
    third = journal(folder)
    assert third.rows == [*kept, row(7)]
    third.close()
