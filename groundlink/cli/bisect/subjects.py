# SPDX-License-Identifier: Apache-2.0
"""What a bisection varies: values of a field, fields of two scenarios, faults, or commits."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import msgspec
from msgspec.structs import replace

from groundlink.bisection.differing_fields import differing_fields
from groundlink.bisection.minimal_set import minimal_set
from groundlink.bisection.number_steps import NumberSteps
from groundlink.bisection.search import Flip, NumberLine, RunVerdict, first_bad, most_probes
from groundlink.cli.run.cases import Case, run_in_shell
from groundlink.core.errors import UserError
from groundlink.core.extras import needs
from groundlink.loader import load
from groundlink.loader.document import Document, read
from groundlink.loader.overrides import FieldChange, field_at
from groundlink.loader.scenario_files import scenario_file
from groundlink.scenario import Scenario

from .commits import Repository
from .probes import SKIP, Candidate
from .recorders import RunRecorder

SEED = "seed"
"""Field whose values have no order."""

LABELS = ("name", "description")
"""Fields of a scenario that change no run."""

SHORT = 60
"""Most characters of a change that is printed with its value."""

Judge = Callable[[Candidate], RunVerdict]


class Finding(NamedTuple):
    """The smallest change that a search has found."""

    words: str
    good: Candidate
    bad: Candidate
    changes: Sequence[Mapping[str, Any]]
    """The change as plain data."""

    skipped: Sequence[str] = ()
    """Names of candidates that may be the first bad one as well."""


class Subject(Protocol):
    """What is varied between a good and a bad run."""

    @property
    def title(self) -> str:
        """One line about the search."""

    @property
    def most_runs(self) -> int | None:
        """Most runs, those of both ends included; None if not known."""

    @property
    def ends(self) -> tuple[Candidate, Candidate]:
        """The good and the bad end."""

    @property
    def setting(self) -> Mapping[str, str]:
        """What all runs have in common, by a name for people."""

    def search(self, judge: Judge) -> Finding:
        """Search the smallest change; both ends have been judged."""


@dataclass(frozen=True)
class RunOf:
    """The scenario of a bisection, as far as it is the same in all runs."""

    scenario: str
    fixed: Case
    recorder: RunRecorder

    def candidate(self, case: Case) -> Candidate:
        """Return the run with further changes of fields."""
        name = ", ".join(change.text for change in case) or "no change"
        changes = (*self.fixed, *case)
        return Candidate(name, lambda out: self.recorder.record(self.scenario, changes, out, None))

    def load(self, case: Case = ()) -> Scenario:
        """Return the scenario with further changes.

        Raises
        ------
        UserError
            if there is no such scenario.
        """
        return load(self.scenario, changes=(*self.fixed, *case))

    @property
    def setting(self) -> Mapping[str, str]:
        """What all runs have in common."""
        content = msgspec.json.encode(self.load())
        return {"scenario": hashlib.sha256(content).hexdigest(), **self.recorder.setting()}


class FieldValues:
    """Values of a field, in their order.

    Parameters
    ----------
    changes
        the first is good, the last is bad.
    """

    def __init__(self, run: RunOf, changes: Sequence[FieldChange]) -> None:
        if len(changes) < 2 or changes[0] == changes[-1]:
            raise UserError(
                f"--set {changes[0].field}: expected a bad value that is not the good one. Fix: "
                "choose two values"
            )
        if changes[0].field == SEED and len(changes) > 2:
            seeds = ",".join(str(change.value) for change in changes)
            raise UserError(
                "--set seed: seeds have no order, so nothing is between two of them. Fix: judge "
                f"each with `groundlink sweep {run.scenario} --set seed={seeds} --check CHECK`"
            )
        for change in (changes[0], changes[-1]):  # mistakes are found before the first run
            run.load((change,))
        self._changes, self._run = changes, run
        self.most_runs: int | None = most_probes(len(changes))
        self.setting = run.setting
        self.ends = self._candidate(0), self._candidate(len(changes) - 1)

    @property
    def title(self) -> str:
        """Field, ends and number of values."""
        first, last, count = self._changes[0], self._changes[-1], len(self._changes)
        return f"{first.field}: {first.value} (good) to {last.value} (bad), {count} values"

    def search(self, judge: Judge) -> Finding:
        """Search two neighboring values, a good and a bad one."""
        last = len(self._changes) - 1
        flip = first_bad(NumberLine(), 0, last, lambda number: judge(self._candidate(number)))
        good, bad = self._changes[max(flip.good)], self._changes[flip.bad]
        return Finding(
            f"{good.field}: good at {good.value}, bad at {bad.value}",
            self._candidate(max(flip.good)),
            self._candidate(flip.bad),
            [{"field": good.field, "good": good.value, "bad": bad.value}],
            [self._candidate(number).name for number in flip.skipped],
        )

    def _candidate(self, number: int) -> Candidate:
        return self._run.candidate((self._changes[number],))


class NumberChanges(Sequence[FieldChange]):
    """The changes of a field to each number of a range."""

    def __init__(self, field: str, steps: NumberSteps) -> None:
        self._field, self._steps = field, steps

    def __len__(self) -> int:
        return len(self._steps)

    def __getitem__(self, number: Any) -> Any:
        index = number if number >= 0 else len(self) + number
        return FieldChange(self._field, self._steps[index])


def between(good: FieldChange, bad: FieldChange, resolution: float | None) -> Sequence[FieldChange]:
    """Return the changes from a good to a bad value, without any between if they have no order.

    Raises
    ------
    UserError
        if there is no such resolution.
    """
    values = (good.value, bad.value)
    is_ordered = all(type(value) in (int, float) for value in values) and good.field != SEED
    if good == bad or not is_ordered:
        if resolution is not None:
            raise UserError("--resolution: expected two numbers with an order. Fix: omit it")
        return (good, bad)
    try:
        return NumberChanges(good.field, NumberSteps(*values, resolution))
    except ValueError:
        raise UserError(f"--resolution {resolution}: expected a number, more than 0") from None


class _Part(NamedTuple):
    """One of several changes that may be needed."""

    name: str
    plain: Mapping[str, Any]
    """The change as plain data."""


class ChangeSet:
    """Changes of which some are needed for the bad run.

    Parameters
    ----------
    parts
        all changes.
    case
        returns the changed fields of some of them, by their numbers.
    what
        name of a part in the plural.
    """

    most_runs: int | None = None

    def __init__(
        self, run: RunOf, parts: Sequence[_Part], case: Callable[[Sequence[int]], Case], what: str
    ) -> None:
        self._run, self._parts, self._case = run, parts, case
        self.title = f"{len(parts)} {what}: {', '.join(part.name for part in parts)}"
        plain = msgspec.json.encode([part.plain for part in parts])
        self.setting = {**run.setting, what: hashlib.sha256(plain).hexdigest()}
        self.ends = self._candidate(()), self._candidate(range(len(parts)))

    def search(self, judge: Judge) -> Finding:
        """Search the changes of which none can be left out."""
        verdicts: dict[tuple[int, ...], RunVerdict] = {(): RunVerdict.GOOD}

        def is_bad(numbers: tuple[int, ...]) -> bool:
            verdicts[numbers] = judge(self._candidate(numbers))
            return verdicts[numbers] is RunVerdict.BAD

        needed = minimal_set(range(len(self._parts)), is_bad)
        good = max(
            (n for n, v in verdicts.items() if v is RunVerdict.GOOD and set(n) < set(needed)),
            key=len,
        )
        names = " and ".join(self._parts[number].name for number in needed)
        return Finding(
            f"needed: {names}",
            self._candidate(good),
            self._candidate(needed),
            [self._parts[number].plain for number in needed],
        )

    def _candidate(self, numbers: Sequence[int]) -> Candidate:
        candidate = self._run.candidate(self._case(numbers))
        names = ", ".join(self._parts[number].name for number in numbers) or "none"
        return candidate._replace(name=names)


def differing_scenarios(good: str, bad: str, fixed: Case, recorder: RunRecorder) -> ChangeSet:
    """Return the fields in which two scenarios differ; the good one is changed.

    Raises
    ------
    UserError
        if they do not differ, or in more than fields that `--set` can change.
    """
    with needs("record"):
        from groundlink.recording.differences import first_difference

    run = RunOf(good, fixed, recorder)
    documents = [read(scenario_file(file)) for file in (good, bad)]
    resolved = Document(msgspec.to_builtins(load(bad, changes=fixed)))
    changes = []
    for path, value in differing_fields(documents[0].value, documents[1].value, resolved.at):
        if path[0] not in LABELS:
            changes.append(FieldChange(field_at(documents[0], path), value))
    if not changes:
        raise UserError(f"{good} and {bad} do not differ. Fix: choose two different scenarios")
    found = [run.load(tuple(changes)), load(bad, changes=fixed)]
    labels = {name: getattr(found[0], name) for name in LABELS}
    plain = [msgspec.to_builtins(each) for each in (found[0], replace(found[1], **labels))]
    if difference := first_difference(*plain):
        raise UserError(
            f"{bad}: `{difference.field}` differs from that of {good} by more than a field of the "
            f"scenario ({difference.recorded} and {difference.repeated}). Fix: put both scenarios "
            "into one folder, with the same files"
        )

    def case(numbers: Sequence[int]) -> Case:
        return tuple(changes[number] for number in numbers)

    parts = [
        _Part(_short(change), {"field": change.field, "bad": change.value}) for change in changes
    ]
    return ChangeSet(run, parts, case, "differing fields")


def _short(change: FieldChange) -> str:
    return change.text if len(change.text) <= SHORT else change.field


def faults_of(run: RunOf) -> ChangeSet:
    """Return the faults of a scenario's sensors; without them the run is good.

    Raises
    ------
    UserError
        if there are none.
    """
    sensors: dict[str, list[Any]] = {
        f"{vehicle.name}/{sensor.name}": msgspec.to_builtins(sensor.faults)
        for vehicle in run.load().vehicles
        for sensor in vehicle.sensors
        if sensor.faults
    }
    places = [(name, i) for name, faults in sensors.items() for i in range(len(faults))]
    if not places:
        raise UserError(f"{run.scenario}: no sensor has faults. Fix: see docs/how-to/faults.md")

    def case(numbers: Sequence[int]) -> Case:
        kept = {places[number] for number in numbers}
        return tuple(
            FieldChange(
                f"vehicles.{name.replace('/', '.sensors.')}.faults",
                [fault for i, fault in enumerate(faults) if (name, i) in kept],
            )
            for name, faults in sensors.items()
        )

    parts = [
        _Part(
            f"{name} fault {i + 1} ({faults[i]['kind']})",
            {"sensor": name, "fault": faults[i]},
        )
        for name, faults in sensors.items()
        for i in range(len(faults))
    ]
    return ChangeSet(run, parts, case, "faults")


class Commits:
    """Commits of the user's stack.

    Parameters
    ----------
    repository
        where they are.
    good, bad
        revisions.
    scenario
        name or file; None where a program of the commits decides. A file of the repository's
        working tree is taken from each commit.
    fixed
        changed fields of the scenario.
    build
        shell command to run in each worktree before the run.
    """

    def __init__(
        self,
        repository: Repository,
        good: str,
        bad: str,
        *,
        scenario: str | None,
        fixed: Case,
        recorder: RunRecorder,
        build: str | None,
    ) -> None:
        self._repository, self._recorder = repository, recorder
        self._good, self._bad = (repository.resolve(revision) for revision in (good, bad))
        if self._good == self._bad:
            raise UserError(
                f"--good {good} and --bad {bad} are the same commit. Fix: choose two commits"
            )
        repository.check_ancestor(self._good, self._bad)
        self._scenario, self._fixed, self._build = scenario, fixed, build
        self._inside = scenario and _inside(repository.tree, scenario)
        if scenario and not self._inside:
            load(scenario, changes=fixed)  # mistakes are found before the first run
        self._count = repository.distance(self._good, self._bad)
        self.most_runs: int | None = most_probes(self._count + 1)
        self.ends = self._candidate(self._good), self._candidate(self._bad)

    @property
    def title(self) -> str:
        """Repository and number of commits."""
        return f"{self._count} commits after {self._good[:12]} up to {self._bad[:12]}"

    @property
    def setting(self) -> Mapping[str, str]:
        """What all runs have in common."""
        common = {**self._recorder.setting(), "build": self._build or ""}
        if self._inside:
            changes = " ".join(change.text for change in self._fixed)
            return {**common, "scenario": f"{self._inside} {changes}"}
        if self._scenario:
            return {**common, **RunOf(self._scenario, self._fixed, self._recorder).setting}
        return common

    def search(self, judge: Judge) -> Finding:
        """Search the first bad commit."""
        flip: Flip[str] = first_bad(
            self._repository, self._good, self._bad, lambda commit: judge(self._candidate(commit))
        )
        guilty = self._repository.describe(flip.bad)
        distance = partial(self._repository.distance, bad=flip.bad)
        nearest = min(flip.good, key=lambda commit: distance(commit))
        name = f"{guilty.sha[:12]} {guilty.subject}"
        return Finding(
            f"first bad commit: {name} ({guilty.author}, {guilty.date})",
            self._candidate(nearest),
            self._candidate(flip.bad),
            [guilty._asdict()],
            [self._candidate(commit).name for commit in flip.skipped],
        )

    def _candidate(self, commit: str) -> Candidate:
        about = self._repository.describe(commit)
        return Candidate(f"{about.sha[:12]} {about.subject}", partial(self._record, commit))

    def _record(self, commit: str, out: Path) -> int:
        with self._repository.worktree(commit) as folder:
            if self._build and run_in_shell(self._build, folder=folder)[1]:
                return SKIP
            scenario = str(folder / self._inside) if self._inside else self._scenario or ""
            return self._recorder.record(scenario, self._fixed, out, folder)


def _inside(tree: Path | None, scenario: str) -> Path | None:
    """Return the path of a scenario's file within a working tree; None if it is elsewhere."""
    file = scenario_file(scenario).resolve()
    return file.relative_to(tree) if tree and file.is_relative_to(tree) else None
