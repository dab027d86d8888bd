# SPDX-License-Identifier: Apache-2.0
"""The order of the tests names files that exist, and `make` finds all tests of the system."""

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
