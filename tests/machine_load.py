# SPDX-License-Identifier: Apache-2.0
"""Tells a failure from a machine that was too busy for a test in real time.

Tests marked `alone` look at rates in real time. When one fails, this measures which share of the
processors other programs took meanwhile. Above `LIMIT` the test is skipped with that figure; in
CI the skip is a failure (`strict_skips.py`).
"""

import os
import time
from collections.abc import Generator, Iterator
from pathlib import Path

import pytest

LIMIT = 0.2
"""The share of all processors that others may take before a failure says nothing."""

_TICKS = os.sysconf("SC_CLK_TCK")
_BEGUN = pytest.StashKey["Usage"]()


def _fields(pid: str) -> list[str]:
    """Return the fields of /proc/PID/stat behind the name, or none of a process that ended."""
    try:
        return Path("/proc", pid, "stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    except OSError:
        return []


def _family() -> Iterator[list[str]]:
    """Yield the fields of this process and of all its living descendants."""
    found = {pid: _fields(pid) for pid in os.listdir("/proc") if pid.isdigit()}
    ours = {str(os.getpid())}
    while grown := {pid for pid, f in found.items() if f and f[1] in ours} - ours:
        ours |= grown
    return (found[pid] for pid in ours if found.get(pid))


class Usage:
    """Processor time up to an instant: that of all programs, and ours."""

    def __init__(self) -> None:
        busy = Path("/proc/stat").read_text(encoding="utf-8").split("\n", 1)[0].split()
        # user, nice, system, irq, softirq and steal; not idle and iowait.
        self.all = sum(int(busy[i]) for i in (1, 2, 3, 6, 7, 8)) / _TICKS
        # User and system time of each process, and of its children that ended.
        self.ours = sum(int(field) for f in _family() for field in f[11:15]) / _TICKS
        self._seconds = time.monotonic()

    def others_since(self, begun: "Usage") -> float:
        """Return the share of all processors that other programs took since `begun`."""
        passed = (self._seconds - begun._seconds) * (os.cpu_count() or 1)
        others = (self.all - begun.all) - (self.ours - begun.ours)
        return max(0.0, others / passed) if passed else 0.0


def judge(report: pytest.TestReport, share: float) -> None:
    """Add the share to a failed report; above the limit make it a skip."""
    said = f"other programs took {share:.0%} of the processors meanwhile"
    report.sections.append(("machine", said))
    if share > LIMIT:
        path, line, _ = report.location
        report.sections.append(("failure on a busy machine", str(report.longrepr)))
        report.outcome = "skipped"
        report.longrepr = (path, line or 0, f"Skipped: the machine is too busy for it: {said}")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item: pytest.Item) -> Generator[None, object, object]:
    """Note the processor time before a test in real time begins."""
    if item.get_closest_marker("alone"):
        item.stash[_BEGUN] = Usage()
    return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Judge the failure of a test in real time by what else the machine had to do."""
    report = yield
    if report.failed and report.when != "teardown" and _BEGUN in item.stash:
        judge(report, Usage().others_since(item.stash[_BEGUN]))
    return report
