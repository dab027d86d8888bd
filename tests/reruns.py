# SPDX-License-Identifier: Apache-2.0
"""A repeated test begins anew, and is shown with its first failure.

pytest-rerunfailures keeps the fixtures of a module while it repeats a test. Where such a fixture is
a running system that went wrong, each repetition would fail by the same.
"""

from collections.abc import Generator

import pytest

_HAS_FAILED = pytest.StashKey[bool]()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Note whether a test has failed."""
    report = yield
    item.stash[_HAS_FAILED] = report.failed or (
        report.when != "setup" and item.stash.get(_HAS_FAILED, False)
    )
    return report


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_teardown(item: pytest.Item) -> None:
    """End all fixtures but those of the session, if a failed test may be repeated."""
    if item.config.getoption("reruns") and item.stash.get(_HAS_FAILED, False):
        item.session._setupstate.teardown_exact(item.session)  # type: ignore[arg-type]


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print what each repeated test failed by."""
    for report in terminalreporter.stats.get("rerun", ()):
        terminalreporter.write_sep("_", f"failed before it was repeated: {report.nodeid}")
        terminalreporter.write_line(report.longreprtext)
        for title, content in report.sections:
            terminalreporter.write_sep("-", title)
            terminalreporter.write_line(content)
