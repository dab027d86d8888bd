# SPDX-License-Identifier: Apache-2.0
"""Run the kit on reference simulators in this process; print what it found as JSON.

Each clause runs on a simulator without a flaw, and then once for each violation that it must catch.
"""

import contextlib
import io
import json
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from _pytest.runner import runtestprotocol

from simulation_interfaces_tck.__main__ import CLAUSES, main
from simulation_interfaces_tck.features import CODES

from .reference import ReferenceSimulator
from .violations import VIOLATIONS, Violation

KIT = (str(CLAUSES), "-c", str(CLAUSES / "pytest.ini"), "--rootdir", str(CLAUSES))
PLUGINS = ("-p", "simulation_interfaces_tck.plugin", "-p", "no:cacheprovider")


class Seeding:
    """pytest plugin: repeats the clause of each violation on a simulator that has it."""

    def __init__(self, simulator: ReferenceSimulator) -> None:
        self.simulator = simulator
        self.outcomes: dict[str, str] = {}
        """Of each clause, on the simulator without a flaw."""
        self.caught: dict[str, str] = {}
        """What the clause says, for each violation that it catches."""

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.when == "call" or report.outcome != "passed":
            name = report.nodeid.rpartition("::")[2]
            self.outcomes[name] = str(report.longrepr or report.outcome)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(
        self, item: pytest.Item, nextitem: pytest.Item | None
    ) -> Iterator[None]:
        done: Any = yield
        for violation in VIOLATIONS:
            if violation.clause == item.name:
                self._seed(item, nextitem, violation)
        return done

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_teardown(self) -> None:
        self.simulator.change = lambda message: None

    def _seed(self, item: pytest.Item, nextitem: pytest.Item | None, violation: Violation) -> None:
        def change(message: Any) -> None:
            if isinstance(message, violation.message):
                violation.change(message)

        self.simulator.change = change
        reports = runtestprotocol(item, log=False, nextitem=nextitem)
        for report in reports:
            if report.when == "call" and report.failed:
                self.caught[violation.name] = str(report.longrepr)
        self.simulator.start()


def run(namespace: str, *arguments: str) -> tuple[int, str]:
    """Run the kit's command; return its exit code and what it prints."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        code = main(["--namespace", namespace, *arguments])
    return code, printed.getvalue()


def all_results(folder: Path) -> dict[str, Any]:
    """Return what the kit finds, for each kind of simulator."""
    results: dict[str, Any] = {}
    with contextlib.closing(ReferenceSimulator(folder)) as simulator:
        seeding = Seeding(simulator)
        with contextlib.redirect_stdout(io.StringIO()):
            pytest.main([*KIT, *PLUGINS], plugins=[seeding])
        results["clauses"] = seeding.outcomes
        results["caught"] = seeding.caught
        results["violations"] = [violation.name for violation in VIOLATIONS]
        junit = folder / "junit.xml"
        results["whole"] = run("/", "-k", "test_deleting", "--junit", str(junit))
        results["junit"] = junit.read_text(encoding="utf-8")
        results["left"] = sorted(simulator.entities)
    kinds = {
        "bare": ReferenceSimulator(folder, "bare", [], ["GetSimulatorFeatures"]),
        "boastful": ReferenceSimulator(folder, "boastful", CODES, ["GetSimulatorFeatures"]),
        "modest": ReferenceSimulator(folder, "modest", []),
    }
    for name, simulator in kinds.items():
        with contextlib.closing(simulator):
            results[name] = run(name, *(("-k", "test_features") if name != "bare" else ()))
    results["none"] = run("nowhere", "--find-timeout", "0.2")
    return results


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as scratch:
        print(json.dumps(all_results(Path(scratch))), file=sys.stdout)
