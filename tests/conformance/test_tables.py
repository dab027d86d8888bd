# SPDX-License-Identifier: Apache-2.0
"""The page of clauses and faults has every clause and every fault.

`PYTHONPATH=conformance/src .venv/bin/python -m tests.conformance.tables` writes its tables.
"""

import pytest

from sensor_conformance.__main__ import parser

from .fault import FAULTS
from .tables import PAGE, clause_table
from .test_report import ROOT


def test_page_has_the_table_of_clauses() -> None:
    assert clause_table() in PAGE.read_text(encoding="utf-8")


def test_page_has_every_fault() -> None:
    rows = [line.split(" | ") for line in PAGE.read_text(encoding="utf-8").splitlines()]
    written = {tuple(row[:3]) for row in rows}
    expected = {(f"| {one.name}", f"`{one.topic}`", f"`{one.clause}`") for one in FAULTS}
    assert expected - written == set()


@pytest.mark.parametrize(
    "option", [name for one in parser()._actions for name in one.option_strings if name[:2] == "--"]
)
def test_readme_has_every_option(option: str) -> None:
    if option != "--help":
        assert f"`{option}" in (ROOT / "conformance" / "README.md").read_text(encoding="utf-8")
