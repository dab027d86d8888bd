# SPDX-License-Identifier: Apache-2.0
"""The first failure of a repeated test is in the output of its run."""

import subprocess
import sys
from pathlib import Path

FLAKY = """
import pytest

CALLS = []

def test_it():
    CALLS.append(1)
    print("what it said")
    assert len(CALLS) > 1, "what was wrong at first"
"""


def test_a_repeated_test_is_shown_with_its_first_failure(tmp_path: Path) -> None:
    (tmp_path / "test_flaky.py").write_text(FLAKY, encoding="utf-8")
    options = ("-c", "/dev/null", "-p", "tests.reruns", "--reruns=1", "-p", "no:cacheprovider")
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *options, str(tmp_path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout
    assert "1 passed, 1 rerun" in done.stdout
    assert "failed before it was repeated: " in done.stdout
    assert "what was wrong at first" in done.stdout
    assert "what it said" in done.stdout
