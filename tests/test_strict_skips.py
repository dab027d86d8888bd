# SPDX-License-Identifier: Apache-2.0
"""A skip fails where every test must run, whichever way it was made."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

MODULES = {
    "in_a_test": "import pytest\ndef test_it():\n    pytest.skip('nothing here')\n",
    "by_a_mark": """
import pytest
@pytest.mark.skipif(True, reason='nothing here')
def test_it():
    pass
""",
    "of_a_module": "import pytest\npytest.importorskip('no_such_module', reason='nothing here')\n",
    "in_a_fixture": """
import pytest
@pytest.fixture
def lacking():
    pytest.skip('nothing here')
def test_it(lacking):
    pass
""",
    "allowed": "import pytest\ndef test_it():\n    "
    "pytest.skip('the program would have to send billions before')\n",
    "expected_failure": "import pytest\n@pytest.mark.xfail\ndef test_it():\n    assert False\n",
}
FORBIDDEN = list(MODULES)[:4]


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, str]]:
    """Return what pytest prints of each module, without and with GROUNDLINK_EVERY_TEST."""
    folder = tmp_path_factory.mktemp("modules")
    for name, text in MODULES.items():
        (folder / f"test_{name}.py").write_text(text, encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-q", "-rA", "-p", "tests.strict_skips"]
    command += ["--continue-on-collection-errors", "-c", os.devnull]
    found = {}
    for every in ("", "1"):
        done = subprocess.run(
            [*command, "--rootdir", str(folder), str(folder)],
            cwd=ROOT,
            env=os.environ
            | {
                "GROUNDLINK_EVERY_TEST": every,
                "PYTEST_ADDOPTS": "",
                "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
            },
            capture_output=True,
            text=True,
            check=False,
        )
        lines = done.stdout.splitlines()
        found[every] = {
            name: "\n".join(line for line in lines if f"test_{name}.py" in line) for name in MODULES
        }
    return found


@pytest.mark.parametrize("name", FORBIDDEN)
def test_a_skip_fails_where_every_test_must_run(
    outcomes: dict[str, dict[str, str]], name: str
) -> None:
    assert "a skip is a failure here: " in outcomes["1"][name]
    lenient = outcomes[""][name]
    assert "SKIPPED [1]" in lenient
    assert "failure" not in lenient


@pytest.mark.parametrize(
    ("name", "told"), [("allowed", "SKIPPED [1]"), ("expected_failure", "XFAIL")]
)
def test_what_is_allowed_or_expected_fails_nowhere(
    outcomes: dict[str, dict[str, str]], name: str, told: str
) -> None:
    assert told in outcomes["1"][name]
