# SPDX-License-Identifier: Apache-2.0
"""A skip fails where every test must run, whichever way it was made."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

IN_A_TEST = "import pytest\ndef test_it():\n    pytest.skip('nothing here')\n"
BY_A_MARK = """
import pytest
@pytest.mark.skipif(True, reason='nothing here')
def test_it():
    pass
"""
OF_A_MODULE = "import pytest\npytest.importorskip('no_such_module', reason='nothing here')\n"
IN_A_FIXTURE = """
import pytest
@pytest.fixture
def lacking():
    pytest.skip('nothing here')
def test_it(lacking):
    pass
"""
ALLOWED = (
    "import pytest\ndef test_it():\n    "
    "pytest.skip('the program would have to send billions before')\n"
)
EXPECTED_FAILURE = "import pytest\n@pytest.mark.xfail\ndef test_it():\n    assert False\n"


def outcome(folder: Path, text: str, every: str) -> str:
    """Return what pytest prints for a module of tests, with GROUNDLINK_EVERY_TEST as given."""
    (folder / "test_it.py").write_text(text, encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "tests.strict_skips", "-c", os.devnull]
    done = subprocess.run(
        [*command, "--rootdir", str(folder), str(folder / "test_it.py")],
        cwd=ROOT,
        env=os.environ | {"GROUNDLINK_EVERY_TEST": every, "PYTEST_ADDOPTS": ""},
        capture_output=True,
        text=True,
        check=False,
    )
    return done.stdout


@pytest.mark.parametrize("text", [IN_A_TEST, BY_A_MARK, OF_A_MODULE, IN_A_FIXTURE])
def test_a_skip_fails_where_every_test_must_run(tmp_path: Path, text: str) -> None:
    assert "a skip is a failure here: " in outcome(tmp_path, text, every="1")
    lenient = outcome(tmp_path, text, every="")
    assert "1 skipped" in lenient
    assert "failure" not in lenient


@pytest.mark.parametrize(("text", "count"), [(ALLOWED, "1 skipped"), (EXPECTED_FAILURE, "1 xf")])
def test_what_is_allowed_or_expected_fails_nowhere(tmp_path: Path, text: str, count: str) -> None:
    assert count in outcome(tmp_path, text, every="1")
