# SPDX-License-Identifier: Apache-2.0
"""Output of verdicts: a table, a summary, and an option that is checked before a run."""

from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console

from groundlink.__main__ import main
from groundlink.cli.expectations.output import expectations_table, summary
from tests.groundlink.expectations.test_junit import RESULTS


def test_each_expectation_is_a_row() -> None:
    console = Console(file=StringIO(), width=120)
    console.print(expectations_table(RESULTS))
    printed = console.file.getvalue()  # type: ignore[attr-defined]
    for result, verdict in zip(RESULTS, ("passed", "failed", "undecided", "skipped"), strict=True):
        (line,) = (line for line in printed.splitlines() if f"│{result.name} " in line)
        assert verdict in line
        assert "0.2 m" in line
        assert "0.3 m" in line


def test_skipped_ones_do_not_count() -> None:
    assert summary(RESULTS) == "1 of 3 expectations passed"


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (["record", "yard", "--out", "run.mcap", "--junit", "none/here.xml"], "no such folder"),
        (["up", "yard", "--junit", "none/here.xml"], "no such folder"),
        (["up", "track", "--until-decided"], "track has no expectations. Fix: add `expect`"),
    ],
)
def test_a_mistake_is_found_before_the_run(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    problem: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert problem in line
