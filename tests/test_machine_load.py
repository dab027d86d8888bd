# SPDX-License-Identifier: Apache-2.0
"""A failure on a busy machine is told with its figure; one on a quiet machine stays a failure."""

import subprocess
import sys

import pytest

from tests.machine_load import LIMIT, Usage, judge

BURN = """
import time
while time.process_time() < 0.5:
    pass
print("burnt", flush=True)
input()
"""


def failed() -> pytest.TestReport:
    where = ("tests/test_it.py", 3, "test_it")
    return pytest.TestReport("test_it", where, {}, "failed", "assert 29.1 > 29.4", "call")


def test_a_failure_on_a_busy_machine_is_a_skip_that_says_how_busy() -> None:
    report = failed()
    judge(report, LIMIT + 0.1)
    assert report.skipped
    assert "other programs took 30% of the processors" in str(report.longrepr)
    assert ("failure on a busy machine", "assert 29.1 > 29.4") in report.sections


def test_a_failure_on_an_idle_machine_stays_one() -> None:
    report = failed()
    judge(report, LIMIT)
    assert report.failed
    assert report.longrepr == "assert 29.1 > 29.4"


def test_what_our_own_programs_take_is_not_that_of_others() -> None:
    """A child counts while it runs and after it was waited for."""
    begun = Usage()
    pipe = subprocess.PIPE
    with subprocess.Popen([sys.executable, "-c", BURN], stdin=pipe, stdout=pipe) as child:
        assert child.stdout
        child.stdout.readline()
        alive = Usage()
        child.communicate(b"\n")
    ended = Usage()
    for now in (alive, ended):
        assert now.ours - begun.ours > 0.45
        # The kernel's sum over all programs is rounded to 10 ms.
        assert now.all - begun.all > now.ours - begun.ours - 0.1
