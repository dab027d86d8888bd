# SPDX-License-Identifier: Apache-2.0
"""A repeated test has fixtures of its own, and its first failure is in the output of its run."""

import subprocess
import sys
from pathlib import Path

import pytest

FLAKY = """
import pytest

CALLS = []

def test_it():
    CALLS.append(1)
    print("what it said")
    assert len(CALLS) > 1, "what was wrong at first"
"""

BROKEN = """
import pytest

MADE = {"session": 0, "module": 0}
ENDED = []

@pytest.fixture(scope="session")
def engine():
    MADE["session"] += 1
    yield
    ENDED.append("session")

@pytest.fixture(scope="module")
def run(engine):
    MADE["module"] += 1
    yield MADE["module"]
    ENDED.append("module")

def test_before(run):
    assert run == 1

def test_it(run):
    assert run > 1, "this run is broken"
    assert ENDED == ["module"], "it was ended before another one was made"

def test_behind(run):
    assert run == 2
    assert MADE == {"session": 1, "module": 2}
"""


def repeated(folder: Path, text: str, *options: str) -> str:
    """Return the output of a file of tests that passed, of which one was repeated."""
    (folder / "test_flaky.py").write_text(text, encoding="utf-8")
    words = ("-c", "/dev/null", "-p", "tests.reruns", "--reruns=1", "-p", "no:cacheprovider")
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *words, *options, str(folder)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout
    assert "passed, 1 rerun" in done.stdout
    return done.stdout


def test_a_repeated_test_is_shown_with_its_first_failure(tmp_path: Path) -> None:
    said = repeated(tmp_path, FLAKY)
    assert "failed before it was repeated: " in said
    assert "what was wrong at first" in said
    assert "what it said" in said


@pytest.mark.parametrize("options", [(), ("--numprocesses=1",)], ids=["here", "in a worker"])
def test_a_repeated_test_gets_a_new_fixture_of_its_module(
    tmp_path: Path, options: tuple[str, ...]
) -> None:
    repeated(tmp_path, BROKEN, *options)
