# SPDX-License-Identifier: Apache-2.0
"""The pytest plugin, in a pytest of its own with a real run."""

import re
import subprocess
import sys
import tomllib

import pytest

from .rig import REPOSITORY

pytestmark = pytest.mark.system

pytest_plugins = ["pytester"]

PLUGIN = "groundlink.sim.pytest_plugin"


def block(page: str, language: str) -> str:
    """Return the first block of a language in a guide."""
    text = (REPOSITORY / "docs" / "how-to" / page).read_text(encoding="utf-8")
    return re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)[0]


def test_a_failed_test_names_the_reports_of_its_runs(pytester: pytest.Pytester) -> None:
    """The tests are those of the guide."""
    pytester.makefile(".yaml", small=block("python-run.md", "yaml"))
    pytester.makepyfile(block("pytest.md", "python"))
    # Without its entry point, which an environment may lack that was installed before.
    options = ("-p", "no:groundlink", "-p", PLUGIN, "-p", "no:cacheprovider", "--basetemp=kept")
    done = pytester.runpytest_subprocess(*options)
    done.assert_outcomes(passed=1, failed=1)
    heading = next(i for i, line in enumerate(done.outlines) if "- Groundlink reports -" in line)
    test = pytester.path / "kept" / "test_rover_reaches_the_other_w0"
    page = test / "groundlink_1" / "run.html"
    assert done.outlines[heading + 1] == str(page)
    assert "small" in page.read_text(encoding="utf-8")
    assert [*pytester.path.rglob("*.html")] == [page]


def test_an_environment_with_groundlink_pays_nothing_for_the_plugin() -> None:
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["entry-points"]["pytest11"] == {"groundlink": PLUGIN}
    program = (
        f"import sys, pytest; before = set(sys.modules); import {PLUGIN}; "
        "print(*sorted(set(sys.modules) - before))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], check=True, capture_output=True, text=True, timeout=60
    )
    own = {"groundlink", "groundlink.core", "groundlink.sim", PLUGIN}
    assert set(done.stdout.split()) <= own
