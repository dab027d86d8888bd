# SPDX-License-Identifier: Apache-2.0
"""The kept list of mutants fits today's sources; `make mutants` plants them."""

from collections import Counter
from pathlib import Path

import pytest

from tests.mutants.catalog import ROOT, Mutant, catalog

LEAST = 150


def test_the_list_is_long_enough_and_has_no_mutant_twice() -> None:
    mutants = catalog()
    assert len(mutants) >= LEAST
    twice = [mutant for mutant, count in Counter(mutants).items() if count > 1]
    assert twice == []


def test_every_place_is_in_its_file_once_and_every_test_is_there() -> None:
    wrong = []
    for mutant in catalog():
        try:
            text = (ROOT / mutant.file).read_text(encoding="utf-8")
            if mutant.planted(text) == text:
                wrong.append(f"{mutant.name}: changes nothing")
        except (OSError, ValueError) as error:
            wrong.append(str(error))
        for test in mutant.tests.split():
            file, _, function = test.partition("::")
            try:
                if function and f"def {function}(" not in (ROOT / file).read_text(encoding="utf-8"):
                    wrong.append(f"{mutant.name}: no {test}")
            except OSError as error:
                wrong.append(f"{mutant.name}: {error}")
    assert wrong == []


def test_a_place_that_is_not_there_once_is_refused() -> None:
    mutant = Mutant("a.py", "x = 1", "x = 2", "wrong", "tests/test_a.py")
    assert mutant.planted("x = 1\n") == "x = 2\n"
    for text in ("", "x = 1\nx = 1\n"):
        with pytest.raises(ValueError, match="expected once"):
            mutant.planted(text)


def test_a_list_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    (tmp_path / "broken.yaml").write_text("- {file: a.py, wass: x}\n", encoding="utf-8")
    with pytest.raises(ValueError, match=r"broken\.yaml"):
        catalog(tmp_path)
