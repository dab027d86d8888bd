# SPDX-License-Identifier: Apache-2.0
"""`groundlink search SCENARIO --vary ... --budget N --out FOLDER`: find values that make it fail.

Each point is a recording of its own. The first failure is shrunk to the smallest change of the
scenario that still fails, which is written as a scenario and recorded again.
"""

import argparse
import shlex
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import msgspec

from groundlink.cli import Subparsers
from groundlink.cli.run.running import load_scenario
from groundlink.cli.terminal.json_output import print_json
from groundlink.cli.terminal.progress import progress
from groundlink.core.atomic_file import write_atomically
from groundlink.core.errors import UserError, did_you_mean
from groundlink.core.extras import needs
from groundlink.loader import load
from groundlink.loader.changed_scenario import changed_text, value_of
from groundlink.loader.overrides import FieldChange
from groundlink.search.point_journal import PointRow, Values
from groundlink.search.rounds import SEARCH, searched
from groundlink.search.sampler import EvenSampler, OptunaSampler, Sampler
from groundlink.search.shrinking import shrunk
from groundlink.search.space import FORM, NumberRange, Point, Space, nearness, point_text, space

from .point_processes import PointProcesses, evaluate_alone
from .result_folder import ResultFolder, add_arguments, check_options

if TYPE_CHECKING:
    from groundlink.report.page.search_page import MinimalFailure

SCENARIO_FILE, RECORDING, PAGE = "minimal.yaml", "minimal.mcap", "search.html"

DETERMINING = (
    *("vary", "check", "duration", "over_link", "objective", "maximize"),
    *("keep_going", "seed", "ahead"),
)
"""Options that determine the points of a search or their outcomes."""

SHRINK = "shrink"
"""Stage of the points that make a failure smaller."""

AGAIN = "again"
"""Stage of the second run of the smallest failure."""


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "search",
        help="look for values of fields with which a scenario fails; shrink the failure",
        description="Record a scenario with many values of its fields until a run or its check "
        "fails. Then put back what is not needed for the failure, and write the rest as a scenario "
        "that fails.",
    )
    add_arguments(parser)
    parser.add_argument(
        "--vary",
        action="append",
        required=True,
        metavar="FIELD=VALUES",
        help=f"values of a field: {FORM}; repeatable",
    )
    parser.add_argument(
        "--budget", type=int, required=True, metavar="N", help="most points to search"
    )
    parser.add_argument(
        "--objective",
        metavar="FIGURE|COMMAND",
        help="key figure to make small, or shell command that prints it, called like --check "
        "(default: points are spread evenly)",
    )
    parser.add_argument(
        "--over-link",
        action="store_true",
        help="recordings have what ROS would receive over the scenario's emulated link",
    )
    parser.add_argument("--maximize", action="store_true", help="make the objective large")
    parser.add_argument(
        "--ahead",
        type=int,
        metavar="N",
        help="points that are chosen before the result of the first of them is known (default: "
        "--jobs); the points of a search depend on it, and not on the number of workers",
    )
    parser.add_argument(
        "--keep-going", action="store_true", help="search the whole budget after a failure, too"
    )
    parser.add_argument(
        "--seed", type=int, default=1, metavar="S", help="seed of the search (default %(default)s)"
    )
    parser.set_defaults(command=search)


def search(options: argparse.Namespace) -> int:
    """Search, shrink and report; return 1 if a point failed."""
    with needs("search"):
        from groundlink.report.page.search_page import SearchSummary, search_page

    check_options(options)
    if options.budget < 1:
        raise UserError(f"--budget {options.budget}: expected 1 or more")
    options.ahead = max(options.jobs, 1) if options.ahead is None else options.ahead
    if options.ahead < 1:
        raise UserError(f"--ahead {options.ahead}: expected 1 or more")
    if options.maximize and not options.objective:
        raise UserError("--maximize: needs --objective")
    whole = space(options.vary)
    scenario = load_scenario(options.scenario)
    origin = {f.name: value_of(f.name, options.scenario, scenario) for f in whole.fields}
    _check_values(options.scenario, whole)
    with ResultFolder(options, scenario, DETERMINING) as folder:
        minimal = _SearchRun(options, whole, origin, folder).minimal_failure()
        rows = [
            msgspec.structs.replace(row, values=origin | row.values)
            for row in folder.journal.rows
            if row.stage != AGAIN
        ]
    summary = SearchSummary(
        options.scenario, whole, origin, rows, options.objective, options.maximize, minimal
    )
    files = folder.write(rows, PAGE, search_page(summary))
    folder.say(f"wrote {files}")
    if options.json:
        print_json({"points": rows, "minimal": minimal})
    return 1 if summary.failures else 0


class _SearchRun:
    """A search: evaluates points, and says the outcome of each.

    Parameters
    ----------
    origin
        the scenario's values of the varied fields.
    """

    def __init__(
        self,
        options: argparse.Namespace,
        whole: Space,
        origin: Mapping[str, Any],
        folder: ResultFolder,
    ) -> None:
        self._options, self._space, self._origin = options, whole, origin
        self._folder, self._journal = folder, folder.journal
        self._request = folder.request(objective=options.objective, over_link=options.over_link)

    def minimal_failure(self) -> "MinimalFailure | None":
        """Search; return the smallest failure of changed fields, None if there is none."""
        with self._folder.processes(self._request, field_changes) as processes:
            if self._fails_unchanged(processes):
                return None
            self._search(processes)
            failures = [
                row.values
                for row in self._journal.rows
                if row.stage == SEARCH and row.outcome.verdict == "failed"
            ]
            if not failures:
                return None
            nearest = min(failures, key=lambda p: nearness(p, self._origin, self._space))
            with progress("shrinking"):
                point = shrunk(
                    nearest, self._origin, self._space, lambda p: self._fails(processes, p)
                )
        return self._repeated(point)

    def _fails_unchanged(self, processes: PointProcesses) -> bool:
        """Run the scenario itself."""
        outcome = self._folder.unchanged(processes)
        objective = self._options.objective
        if objective and outcome.objective is None:
            self._journal.discard()
            raise UserError(
                f"--objective {objective}: neither a key figure nor a command that prints a "
                f"number; {did_you_mean(objective, outcome.figures)}"
            )
        return outcome.verdict == "failed"

    def _search(self, processes: PointProcesses) -> None:
        """Evaluate points until one fails, or all of the budget."""
        options = self._options
        sampler: Sampler = EvenSampler(self._space, options.seed)
        if options.objective:
            sampler = OptunaSampler(self._space, options.seed, maximize=options.maximize)
        with progress("searching") as done:
            for number, point, outcome in searched(
                sampler, processes, options.budget, options.ahead, keep_going=options.keep_going
            ):
                words = f"{number} of {options.budget}: {point_text(point)}"
                self._folder.say_outcome(words, outcome)
                done(number / options.budget)

    def _fails(self, processes: PointProcesses, point: Point) -> bool:
        """Return whether a point fails, for shrinking."""
        number = 1 + sum(row.stage == SHRINK for row in self._journal.rows)
        processes.start(SHRINK, number, point)
        outcome = processes.result(point)
        self._folder.say_outcome(f"{SHRINK}: {point_text(point)}", outcome)
        return outcome.verdict == "failed"

    def _repeated(self, point: Point) -> "MinimalFailure":
        """Write the smallest failure as a scenario, and run that."""
        from groundlink.report.page.search_page import MinimalFailure

        out = self._options.out
        file, recording = out / SCENARIO_FILE, out / RECORDING
        changes = field_changes(point)
        with write_atomically(file) as part:
            part.write_text(
                f"# {self._options.scenario} with {point_text(point)}\n"
                + changed_text(self._options.scenario, changes, out),
                encoding="utf-8",
            )
        outcome = self._journal.outcome({AGAIN: point})
        if outcome is None or not recording.exists():
            request = msgspec.structs.replace(
                self._request, scenario=str(file), recording=str(recording)
            )
            outcome = evaluate_alone(request)
            self._journal.add(PointRow(AGAIN, 1, {AGAIN: point}, outcome))
        again = "fails again" if outcome.verdict == "failed" else "does not fail again"
        self._folder.say(f"smallest failure: {point_text(point)}: {again}: {outcome.text}")
        self._folder.say(f"wrote {file}, {recording}")
        words = ["groundlink", "record", str(file), "--out", "again.mcap"]
        words += ["--duration", f"{self._options.duration:g}"]
        words += ["--over-link"] if self._options.over_link else []
        return MinimalFailure(point, outcome, shlex.join(words))


def field_changes(values: Values) -> list[FieldChange]:
    """Return the changes of a scenario at a point."""
    return [FieldChange(name, value) for name, value in values.items()]


def _check_values(scenario: str, whole: Space) -> None:
    """Load the scenario with the ends of each range and each value of a list.

    Raises
    ------
    UserError
        if it has no such field, or refuses a value.
    """
    for field in whole.fields:
        is_range = isinstance(field, NumberRange)
        for index in (0, field.count - 1) if is_range else range(field.count):
            load(scenario, changes=field_changes({field.name: field.value(index)}))
