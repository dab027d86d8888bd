# SPDX-License-Identifier: Apache-2.0
"""Where `GROUNDLINK_EVERY_TEST` is set, as in CI, a skipped test is a failed test.

A machine that lacks a program or a library skips the tests that need it. In CI all of them are
installed, so a skip there means that something was not built or not found. Only the tests of
`ALLOWED` may be skipped everywhere.
"""

import os
from collections.abc import Generator
from typing import Any

import pytest

ALLOWED = (
    # Two vectors end a sequence of 2^32 messages, which only a program that can set its
    # counter can send.
    "the program would have to send billions before",
)


def _forbid(report: Any) -> None:
    """Make a skipped report a failed one, unless the skip is allowed."""
    if not report.skipped or hasattr(report, "wasxfail"):
        return
    reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
    if not reason.endswith(ALLOWED):
        report.outcome = "failed"
        report.longrepr = f"{report.nodeid}: a skip is a failure here: {reason}"


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Judge a test that was skipped in its setup or in its body."""
    report = yield
    if os.environ.get("GROUNDLINK_EVERY_TEST"):
        _forbid(report)
    return report


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """Judge a module that was skipped while it was collected."""
    report = yield
    if os.environ.get("GROUNDLINK_EVERY_TEST"):
        _forbid(report)
    return report
