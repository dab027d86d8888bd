# SPDX-License-Identifier: Apache-2.0
"""pytest plugin: connects to the simulator, selects the clauses of its features, and reports them.

`python -m simulation_interfaces_tck` loads it; so does
``pytest -p simulation_interfaces_tck.plugin --pyargs simulation_interfaces_tck.clauses``.
rclpy is imported by the first clause, not by this module.
"""

from collections import Counter
from collections.abc import Generator, Iterator
from dataclasses import dataclass, field
from importlib.util import find_spec
from typing import TYPE_CHECKING

import pytest

from .options import add_options

if TYPE_CHECKING:
    from .client import SimulatorClient
    from .scene import SimulatorScene

NOT_ANNOUNCED = "not announced"
NOT_TESTED = "not tested"
PASSED, FAILED = "passed", "failed"


@dataclass
class ClauseReport:
    """Outcomes of the session: a row for each feature, and a line for each finding."""

    counts: dict[str, Counter[str]] = field(default_factory=dict)
    findings: list[tuple[str, str, str, str]] = field(default_factory=list)
    """Feature, clause, its place in the standard, and what was wrong."""
    open: list[tuple[str, str, str]] = field(default_factory=list)
    """Feature, clause, and why it was not tested."""
    announced: frozenset[str] = frozenset()
    """Names of the features that the simulator announces."""
    left: list[str] = field(default_factory=list)
    """Entities that could not be removed."""

    def add(self, item: pytest.Item, outcome: str, line: str) -> None:
        """Count the outcome of a clause."""
        source, feature, _ = clause_of(item)
        self.counts.setdefault(feature, Counter())[outcome] += 1
        if outcome == FAILED:
            self.findings.append((feature, item.name, source, line))
        elif outcome == NOT_TESTED:
            self.open.append((feature, item.name, line))

    def rows(self, codes: dict[str, int]) -> list[str]:
        """Return the table, a row for each feature and each service without a code."""
        lines = [f"{'feature':<26} {'code':>4}  {PASSED:>6}  {FAILED:>6}  {NOT_TESTED:>10}"]
        for feature in [*(name for name in self.counts if name not in codes), *codes]:
            if not (counts := self.counts.get(feature, Counter())):
                continue  # deselected
            numbers = f"{counts[PASSED]:>6}  {counts[FAILED]:>6}  {counts[NOT_TESTED]:>10}"
            if feature in codes and feature not in self.announced:
                is_wrong = counts[FAILED] > 0
                numbers = f"{numbers}  {NOT_ANNOUNCED}" if is_wrong else NOT_ANNOUNCED
            lines.append(f"{feature:<26} {codes.get(feature, ''):>4}  {numbers}")
        return lines


_REPORT = pytest.StashKey[ClauseReport]()


def clause_of(item: pytest.Item) -> tuple[str, str, tuple[str, ...]]:
    """Return where a clause stands, its feature, and the features that its test needs."""
    mark = item.get_closest_marker("clause")
    assert mark, f"{item.name} lacks the mark `clause`"
    source, feature, needs = mark.args
    if not feature:
        assert isinstance(item, pytest.Function)
        feature = item.callspec.params["feature"]
    return source, feature, needs


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options of the kit."""
    add_options(parser.getgroup("simulator under test").addoption)


@pytest.hookimpl(tryfirst=True)
def pytest_configure(config: pytest.Config) -> None:
    """Check the requirements; set up the report."""
    missing = [name for name in ("rclpy", "simulation_interfaces") if find_spec(name) is None]
    if missing:
        raise pytest.UsageError(
            f"{' and '.join(missing)} not found. Fix: install ROS 2 with simulation_interfaces 2.1 "
            "and source its setup file"
        )
    config.addinivalue_line("markers", "clause(source, feature, needs): a clause of the standard")
    config.addinivalue_line("markers", "announced_or_not: a clause of features of both kinds")
    config.stash[_REPORT] = ClauseReport()
    if config.option.junit:
        config.option.xmlpath = config.option.junit


@pytest.fixture(scope="session")
def simulator(request: pytest.FixtureRequest) -> "Iterator[SimulatorClient]":
    """Services of the simulator under test."""
    from .client import SimulatorClient

    options = request.config.option
    client = SimulatorClient(options.namespace, options.call_timeout, options.find_timeout)
    client.find()
    request.config.stash[_REPORT].announced = client.announced
    yield client
    client.close()


@pytest.fixture(scope="session")
def session_scene(
    request: pytest.FixtureRequest, simulator: "SimulatorClient"
) -> "Iterator[SimulatorScene]":
    """Keep what the session does to the simulator."""
    from .scene import SimulatorScene

    options = request.config.option
    scene = SimulatorScene(
        simulator,
        options.spawnable,
        options.definition,
        options.world,
        tuple(options.origin),
        options.spacing,
        options.tolerance,
    )
    yield scene
    request.config.stash[_REPORT].left = scene.left


@pytest.fixture
def scene(session_scene: "SimulatorScene") -> "Iterator[SimulatorScene]":
    """Keep what a clause does to the simulator, and put it back."""
    yield session_scene
    session_scene.put_back()


@pytest.fixture(autouse=True)
def announced(request: pytest.FixtureRequest, simulator: "SimulatorClient") -> None:
    """Run the clauses of announced features; report the others as not announced or not tested."""
    item = request.node
    _, feature, needs = clause_of(item)
    if item.get_closest_marker("announced_or_not"):
        return
    if feature in _codes() and feature not in simulator.announced:
        pytest.skip(NOT_ANNOUNCED)
    simulator.need(*needs)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Count a clause: its call, or the setup or the putting back that went wrong."""
    report = yield
    if report.when != "call" and not (report.failed or report.skipped):
        return report
    line = _line_of(report)
    outcome: str = report.outcome
    if report.skipped:
        outcome = NOT_ANNOUNCED if line == NOT_ANNOUNCED else NOT_TESTED
        line = line.removeprefix(f"{NOT_TESTED}: ")
    source, feature, _ = clause_of(item)
    item.user_properties[:] = [("feature", feature), ("clause", source)]
    report.user_properties = list(item.user_properties)
    item.config.stash[_REPORT].add(item, outcome, line)
    return report


def pytest_report_teststatus(report: pytest.TestReport) -> tuple[str, str, str] | None:
    """Name the skipped clauses as what they are."""
    if not report.skipped:
        return None
    if _line_of(report) == NOT_ANNOUNCED:
        return NOT_ANNOUNCED, "-", NOT_ANNOUNCED.upper()
    return NOT_TESTED, "?", NOT_TESTED.upper()


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    """Print the findings and the table of features."""
    report = config.stash[_REPORT]
    if not report.counts:
        return
    write = terminalreporter.write_line
    write("")
    for feature, name, source, line in report.findings:
        write(f"FAILED {feature}: {name} ({source})")
        write(f"       {line}")
    for feature, name, why in report.open:
        write(f"NOT TESTED {feature}: {name}: {why}")
    write("")
    for row in report.rows(_codes()):
        write(row)
    if report.left:
        write(f"left in the simulator, which does not delete: {', '.join(report.left)}")


def _line_of(report: pytest.TestReport) -> str:
    """Return why a clause failed or was left out, in one line."""
    if isinstance(report.longrepr, tuple):  # file, line and reason of a skipped test
        return report.longrepr[2].removeprefix("Skipped: ")
    if crash := getattr(report.longrepr, "reprcrash", None):
        return str(crash.message).partition("\n")[0].removeprefix("Failed: ")
    return str(report.longrepr or "").strip().rpartition("\n")[2]


def _codes() -> dict[str, int]:
    from .features import CODES

    return CODES
