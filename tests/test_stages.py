# SPDX-License-Identifier: Apache-2.0
"""The stages find all tests, in their order, and each invariant is tested each day."""

import re
from pathlib import Path

from .conftest import LONGEST

ROOT = Path(__file__).resolve().parents[1]


def test_the_longest_files_exist() -> None:
    assert not [file for file in LONGEST if not (ROOT / file).exists()]


def test_make_collects_each_file_with_system_tests() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    found = re.search(r"(?m)^SYSTEM_TESTS := ((?:.*\\\n)*.*)$", makefile)
    assert found
    collected = [ROOT / place for place in found[1].replace("\\\n", " ").split()]
    marked = re.compile(r"(?m)^(pytestmark = |@).*pytest\.mark\.(system|alone)\b")
    on_an_engine = ROOT / "tests" / "deploy"  # `make test-stack`
    missed = [
        file
        for file in (ROOT / "tests").rglob("test_*.py")
        if marked.search(file.read_text(encoding="utf-8"))
        and not any(file.is_relative_to(place) for place in (*collected, on_an_engine))
    ]
    assert not missed


def test_each_invariant_is_tested_each_day() -> None:
    """A file whose tests are all nightly is no guard."""
    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    table = text.partition("## Invariants")[2].partition("\n## ")[0]
    nightly = re.compile(r"(?m)^pytestmark = .*pytest\.mark\.nightly")
    named = re.findall(r"`(tests/[^`]+)`", table)
    assert len(named) > 40
    unguarded = []
    for name in named:
        found = [path for place in ROOT.glob(name) for path in (place, *place.rglob("test_*.py"))]
        files = [path for path in found if path.is_file()]
        if all(nightly.search(file.read_text(encoding="utf-8")) for file in files):
            unguarded.append(name)
    assert not unguarded
