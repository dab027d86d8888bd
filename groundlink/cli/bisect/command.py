# SPDX-License-Identifier: Apache-2.0
"""`groundlink bisect`: find the smallest change that makes a good run bad.

Varies a field, all fields in which two scenarios differ, the faults of a scenario, or the commits
of a stack. Each probe is one run; runs are exact, so none is repeated.
"""

import argparse
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from msgspec import to_builtins

from groundlink.bisection.search import RunVerdict
from groundlink.cli import Subparsers
from groundlink.cli.run.running import SCENARIO_HELP
from groundlink.cli.terminal import output as terminal
from groundlink.cli.terminal.json_output import add_json_option, print_json
from groundlink.core.atomic_file import write_atomically
from groundlink.core.errors import UserError
from groundlink.core.extras import needs
from groundlink.loader import overrides
from groundlink.loader.overrides import FieldChange

from .commits import Repository
from .probes import Prober
from .recorders import ProgramRecorder, RunRecorder, ScenarioRecorder, StackRecorder
from .subjects import (
    Commits,
    FieldValues,
    Finding,
    RunOf,
    Subject,
    between,
    differing_scenarios,
    faults_of,
)

if TYPE_CHECKING:
    from groundlink.recording.run_difference import RunDifference

END = "VALUE|SCENARIO|REV"

GOOD, BAD = "good.mcap", "bad.mcap"
"""Recordings of the last good and the first bad run."""


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "bisect",
        help="find the smallest change of a field, a scenario or a stack that makes a run bad",
        description="Find the smallest change that makes a good run bad: a value of a field, the "
        "fields in which two scenarios differ, the faults of a scenario, or a commit. CHECK is a "
        "command that judges a recording, its last argument: exit code 0 for good, 125 where it "
        "cannot judge, other codes up to 124 for bad. Without CHECK the exit code of `groundlink "
        "record` decides.",
        usage="%(prog)s SCENARIO --set FIELD --good VALUE --bad VALUE [options] [-- CHECK...]\n"
        "       %(prog)s SCENARIO --set FIELD=VALUE,VALUE,... [options] [-- CHECK...]\n"
        "       %(prog)s --good SCENARIO --bad SCENARIO [options] [-- CHECK...]\n"
        "       %(prog)s SCENARIO --faults [options] [-- CHECK...]\n"
        "       %(prog)s [SCENARIO] --repository DIR --good REV --bad REV [options] [-- CHECK...]",
    )
    parser.add_argument("scenario", nargs="?", help=SCENARIO_HELP)
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="FIELD|FIELD=VALUE,...",
        help="the field to vary between --good and --bad, or with its values from a good to a bad "
        "one; FIELD=VALUE is the same in all runs; repeatable",
    )
    parser.add_argument("--good", metavar=END, help="value, scenario or revision of a good run")
    parser.add_argument("--bad", metavar=END, help="the same of a bad run")
    parser.add_argument(
        "--resolution",
        type=float,
        metavar="STEP",
        help="smallest difference of two numbers (default: 1 between integers, else a hundredth "
        "of the difference)",
    )
    parser.add_argument(
        "--faults", action="store_true", help="find the faults of the scenario that are needed"
    )
    parser.add_argument(
        "--repository",
        type=Path,
        metavar="DIR",
        help="find the first bad commit of this git repository, each in a temporary worktree",
    )
    parser.add_argument(
        "--build", metavar="COMMAND", help="shell command to run in each worktree before the run"
    )
    how = parser.add_mutually_exclusive_group()
    how.add_argument(
        "--stack",
        metavar="COMMAND",
        help="shell command that starts a ROS stack, in the worktree; the scenario has `lockstep: "
        "ros`",
    )
    how.add_argument(
        "--program",
        metavar="COMMAND",
        help="instead of a scenario: shell command that makes the recording, its last argument, in "
        "the worktree",
    )
    parser.add_argument("--duration", metavar="S", help="sim time of each run (default 30 s)")
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("bisect"),
        metavar="FOLDER",
        help="folder for recordings and verdicts; with that of an interrupted bisection the search "
        "continues (default %(default)s)",
    )
    add_json_option(parser)
    _take_command(parser)
    parser.set_defaults(command=bisect)


def _take_command(parser: argparse.ArgumentParser) -> None:
    """Put the words after `--` into `check`.

    argparse cannot: it would take the scenario, which is optional, for the first of them.
    """
    parse = parser.parse_known_args

    def parse_before(words: Any = None, options: Any = None) -> Any:
        words = [*words]
        end = words.index("--") if "--" in words else len(words)
        options, rest = parse(words[:end], options)
        options.check = words[end + 1 :]
        return options, rest

    parser.parse_known_args = parse_before  # type: ignore[method-assign, assignment]


def bisect(options: argparse.Namespace) -> int:
    """Search; return 0 if one smallest change was found, 1 if skipped candidates remain."""
    with needs("record"):
        from groundlink.recording.reader import Recording
        from groundlink.recording.run_difference import first_run_difference

    console = terminal.console(stderr=options.json)

    def say(line: str) -> None:
        terminal.say(console, line)

    subject = _subject(options)
    folder = options.out.resolve()
    prober = Prober(folder, subject.setting, options.check, subject.most_runs, say)
    say(subject.title)
    try:
        for end, verdict in zip(subject.ends, (RunVerdict.GOOD, RunVerdict.BAD), strict=True):
            prober.expect(end, verdict)
        found = subject.search(prober.probe)
    except KeyboardInterrupt:
        say(f"{options.out} has the finished runs; the same command continues")
        raise
    kept = [(found.good, folder / GOOD), (found.bad, folder / BAD)]
    for candidate, file in kept:
        with write_atomically(file) as part:
            shutil.copyfile(prober.recording(candidate), part)
    with Recording(kept[0][1]) as good, Recording(kept[1][1]) as bad:
        difference = first_run_difference(good, bad)
    if options.json:
        print_json(_as_json(found, prober, difference, [str(file) for _, file in kept]))
    else:
        _show(found, prober, difference, options.out, say)
    return 1 if found.skipped else 0


def _subject(options: argparse.Namespace) -> Subject:
    """Return what the options ask to vary.

    Raises
    ------
    UserError
        when they do not fit together.
    """
    fixed, varied = _split(options.set)
    recorder = _recorder(options)
    _check_options(options, varied)
    if options.repository:
        return Commits(
            Repository(options.repository),
            options.good,
            options.bad,
            scenario=options.scenario,
            fixed=fixed,
            recorder=recorder,
            build=options.build,
        )
    if not options.scenario:
        return differing_scenarios(options.good, options.bad, fixed, recorder)
    run = RunOf(options.scenario, fixed, recorder)
    if options.faults:
        return faults_of(run)
    text = varied[0]
    if "=" in text:
        return FieldValues(run, overrides.alternatives(text))
    good, bad = overrides.field_changes([f"{text}={options.good}", f"{text}={options.bad}"])
    return FieldValues(run, between(good, bad, options.resolution))


def _split(texts: Sequence[str]) -> tuple[tuple[FieldChange, ...], list[str]]:
    """Return the changes of all runs, and the texts of what is varied."""
    fixed: list[FieldChange] = []
    varied = []
    for text in texts:
        changes = overrides.alternatives(text) if "=" in text else []
        if len(changes) == 1:
            fixed += changes
        else:
            varied.append(text)
    return tuple(fixed), varied


def _recorder(options: argparse.Namespace) -> RunRecorder:
    if options.program:
        return ProgramRecorder(options.program)
    try:
        is_positive = options.duration is None or float(options.duration) > 0
    except ValueError:
        is_positive = False
    if not is_positive:
        raise UserError(f"--duration {options.duration}: expected seconds, more than 0")
    if options.stack:
        return StackRecorder(options.stack, options.duration)
    return ScenarioRecorder(options.duration)


def _check_options(options: argparse.Namespace, varied: Sequence[str]) -> None:
    """Check that the options ask for one bisection.

    Raises
    ------
    UserError
        if not, with what is missing or too much.
    """
    has_values = any("=" in text for text in varied)
    ways = {
        "--repository": bool(options.repository),
        "--faults": options.faults,
        "--set FIELD": bool(varied),
    }
    chosen = [way for way, is_chosen in ways.items() if is_chosen] or ["two scenarios"]
    ends = [end for end in (options.good, options.bad) if end is not None]
    has_own_ends = options.faults or has_values
    mistakes = {
        f"{' and '.join(chosen)}: expected one of them": len(chosen) > 1,
        f"--set {', '.join(varied)}: expected one varied field": len(varied) > 1,
        "a scenario alone. Fix: add `--set FIELD`, --faults or --repository": bool(options.scenario)
        and chosen == ["two scenarios"],
        f"{chosen[0]}: the scenario is missing": not options.scenario
        and chosen[0] in ("--faults", "--set FIELD"),
        "--good and --bad: expected both": not has_own_ends and len(ends) < 2,
        f"{chosen[0]}: expected no --good and --bad": has_own_ends and bool(ends),
        "--repository: expected a scenario or --program": bool(options.repository)
        and bool(options.scenario) == bool(options.program),
        "--program: expected --repository, and no --set": bool(options.program)
        and (not options.repository or bool(options.set)),
        "--build: expected --repository": bool(options.build) and not options.repository,
        "--resolution: expected `--set FIELD --good NUMBER --bad NUMBER`": options.resolution
        is not None
        and (has_values or not varied),
    }
    for mistake, is_made in mistakes.items():
        if is_made:
            raise UserError(f"bisect: {mistake}; see `groundlink bisect --help`")


def _show(
    found: Finding,
    prober: Prober,
    difference: "RunDifference | None",
    out: Path,
    say: Callable[[str], None],
) -> None:
    """Print the result."""
    earlier = len(prober.probes) - prober.runs
    known = f", {earlier} of them from an earlier bisection" if earlier else ""
    say(f"{found.words}; {len(prober.probes)} probes{known}")
    for name in found.skipped:
        say(f"not judged, and possibly the first bad one: {name}")
    if difference is None:
        say("no difference between both recordings")
    else:
        field = f"{difference.field}: " if difference.field else ""
        say(
            f"first difference: {difference.topic} at {difference.sim_seconds:.6f} s, message "
            f"{difference.number}: {field}{difference.first} good, {difference.second} bad"
        )
    say(f"wrote {out / GOOD} ({found.good.name}) and {out / BAD} ({found.bad.name})")


def _as_json(
    found: Finding, prober: Prober, difference: "RunDifference | None", recordings: list[str]
) -> dict[str, Any]:
    names = ("name", "recording", "run_code", "verdict", "line")
    return {
        "found": found.words,
        "good": found.good.name,
        "bad": found.bad.name,
        "changes": found.changes,
        "not_judged": found.skipped,
        "runs": prober.runs,
        "probes": [{name: getattr(probe, name) for name in names} for probe in prober.probes],
        "first_difference": _difference_as_json(difference),
        "recordings": dict(zip(("good", "bad"), recordings, strict=True)),
    }


def _difference_as_json(difference: "RunDifference | None") -> dict[str, Any] | None:
    if difference is None:
        return None
    plain: dict[str, Any] = to_builtins(difference)
    return plain | {"good": plain.pop("first"), "bad": plain.pop("second")}
