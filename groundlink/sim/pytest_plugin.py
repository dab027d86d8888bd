# SPDX-License-Identifier: Apache-2.0
"""pytest plugin: the fixture `groundlink_run` starts runs; a failed test gets their reports.

pytest imports this module in every environment with Groundlink, so it imports nothing else until a
test uses the fixture.
"""

import subprocess
import sys
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import pytest

import groundlink

if TYPE_CHECKING:
    from groundlink.sim.sim_time import Mode
    from groundlink.sim.stepped_run import SteppedRun

RECORDING = "run.mcap"


class StartRun(Protocol):
    """Starts a run that a test steps."""

    def __call__(
        self, scenario: str | Path, *, mode: "Mode" = "fast", sensors_together: bool = False
    ) -> "SteppedRun":
        """Start a run, as `groundlink.run` does; it is recorded, and closed after the test."""


class _Runs:
    """The runs of one test, each recorded to a folder of its own."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._runs: list[SteppedRun] = []

    def start(
        self, scenario: str | Path, *, mode: "Mode" = "fast", sensors_together: bool = False
    ) -> "SteppedRun":
        """Start a run; see `StartRun`."""
        folder = self._folder / f"groundlink_{len(self._runs) + 1}"
        folder.mkdir(exist_ok=True)
        run = groundlink.run(
            scenario, mode=mode, sensors_together=sensors_together, record=folder / RECORDING
        )
        self._runs.append(run)
        return run

    def close(self) -> None:
        """End the runs."""
        for run in self._runs:
            run.close()

    def reports(self) -> list[str]:
        """End the runs; return the path of each recording's report, or why there is none."""
        self.close()
        return [_report(file) for file in sorted(self._folder.glob("groundlink_*/*.mcap"))]


_RUNS = pytest.StashKey[_Runs]()


@pytest.fixture
def groundlink_run(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[StartRun]:
    """Start runs: `sim = groundlink_run("small.yaml")`; if the test fails, write their reports."""
    runs = request.node.stash[_RUNS] = _Runs(tmp_path)
    yield runs.start
    runs.close()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Add the paths of the reports to the output of a failed test."""
    report = yield
    if report.failed and (runs := item.stash.get(_RUNS, None)) and (pages := runs.reports()):
        report.sections.append(("Groundlink reports", "\n".join(pages)))
    return report


def _report(recording: Path) -> str:
    """Write the report of a recording; return its path, or why there is none."""
    page = recording.with_suffix(".html")
    command = [sys.executable, "-m", "groundlink", "report", str(recording), "--out", str(page)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return str(page) if done.returncode == 0 else done.stderr.strip()
