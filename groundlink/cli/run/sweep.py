# SPDX-License-Identifier: Apache-2.0
"""`groundlink sweep SCENARIO --set FIELD=A,B`: record a scenario with other values; table figures.

Where only sensors, weather or light differ, they are simulated again on a drive recorded before.

Also `groundlink sweep EXPERIMENT --vary SENSOR.FIELD=[A, B]`, which repeats an experiment of the
repository. The experiments are not part of the package.
"""

import argparse
import csv
import itertools
import json
import os
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console

from groundlink.cli import Subparsers
from groundlink.cli.terminal import output as terminal
from groundlink.cli.terminal.json_output import add_json_option, print_json
from groundlink.cli.terminal.progress import progress
from groundlink.cli.terminal.tables import Column, FittingTable
from groundlink.core.atomic_file import write_atomically
from groundlink.core.errors import UserError
from groundlink.core.extras import needs
from groundlink.loader import load, overrides
from groundlink.scenario import Scenario

from .cases import Case, check_recording, exit_code, record_case
from .record import keeps_rate
from .running import SCENARIO_HELP

EXPERIMENTS = "experiments.studies.sweep"
REPOSITORY = Path(__file__).resolve().parents[3]

CHECK = "check"
"""Column of what `--check` printed."""

Row = dict[str, Any]
"""Values of the changed fields, what `--check` printed, and figures, by column."""


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "sweep",
        help="record a scenario with several values of its fields; print a table of figures",
        description="Record a scenario once for each value, or each combination of values, and "
        "print a table of the figures that differ. Where only sensors, weather or light differ, "
        "one recorded drive serves all. With --vary: repeat an experiment of the "
        "repository, and print a table of its errors.",
    )
    parser.add_argument("scenario", help=f"{SCENARIO_HELP}; with --vary an experiment")
    way = parser.add_mutually_exclusive_group(required=True)
    way.add_argument(
        "--set",
        action="append",
        metavar="FIELD=VALUE,...",
        help="values of a field, such as lidar.dropout=0,0.1; repeatable, for all combinations",
    )
    way.add_argument(
        "--vary",
        action="append",
        metavar="SENSOR.FIELD=[A,...]",
        help="values of a field of an experiment's sensor; repeatable",
    )
    parser.add_argument("--duration", metavar="S", help="sim time of each run (default 30 s)")
    parser.add_argument(
        "--check",
        metavar="COMMAND",
        help="shell command to run on each recording, whose name is its last argument; its last "
        "line becomes a column, and an exit code other than 0 a failure",
    )
    add_json_option(parser)
    parser.add_argument("--seeds", metavar="N", help="with --vary: runs of each (default 1)")
    parser.add_argument("--short", action="store_true", help="with --vary: 20 s of driving")
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FOLDER",
        help="new folder for the recordings and table.csv (default: none are kept); with --vary: "
        "folder of the experiments",
    )
    parser.set_defaults(command=sweep)


def sweep(options: argparse.Namespace) -> int:
    """Run all cases; return 0 if every run kept its rates and every check succeeded."""
    if options.vary:
        return _sweep_experiment(options)
    return _sweep_scenario(options)


def _sweep_scenario(options: argparse.Namespace) -> int:
    with needs("report"):
        from groundlink.report.analysis.key_figures import key_figures_of

    cases: list[Case] = list(itertools.product(*map(overrides.alternatives, options.set)))
    # Mistakes are found before the first run.
    scenarios = [load(options.scenario, changes=case) for case in cases]
    console = terminal.console(stderr=options.json)
    rows: list[Row] = []
    failed = []
    drives: list[_Drive] = []
    with _folder(options.out) as folder, tempfile.TemporaryDirectory() as temporary:
        for number, (case, scenario) in enumerate(zip(cases, scenarios, strict=True), 1):
            words = ", ".join(change.text for change in case)
            said = f"{number} of {len(cases)}: {words}"
            recording = folder / f"{number}.mcap"
            drive = next((each for each in drives if each.is_of(scenario)), None)
            if drive is None:
                terminal.say(console, said)
                code = record_case(options.scenario, case, recording, options.duration)
                if code not in (0, 1) or not recording.exists():
                    return code or 1
                if code == 0 and len(cases) > number:
                    drives.append(_Drive(number, scenario, recording, Path(temporary)))
            else:
                terminal.say(console, f"{said} (sensors only, on the drive of {drive.number})")
                code = drive.record(scenario, recording)
            row: Row = {change.field: change.value for change in case}
            if options.check:
                row[CHECK], check_code = check_recording(options.check, recording)
                code = code or check_code
            rows.append(row | key_figures_of(recording))
            failed += [words] if code else []
            if not options.out and recording not in [each.recording for each in drives]:
                recording.unlink()
        if options.out:
            _write_csv(folder / "table.csv", rows)
    if options.json:
        print_json({"runs": rows, "failed": failed})
    else:
        _show(console, options.scenario, rows, varied=len(options.set))
    for words in failed:
        terminal.say(console, f"failed: {words}")
    return 1 if failed else 0


class _Drive:
    """A recorded drive, on which sensors are simulated again."""

    def __init__(self, number: int, scenario: Scenario, recording: Path, folder: Path) -> None:
        self.number, self.recording = number, recording
        self._scenario, self._file = scenario, folder / f"{number}.drive"

    def is_of(self, scenario: Scenario) -> bool:
        """Return whether another scenario has this drive."""
        from groundlink.recording.resimulation import have_same_drive

        return have_same_drive(self._scenario, scenario)

    def record(self, scenario: Scenario, to: Path) -> int:
        """Write the recording of another scenario; return 0 if it has every declared rate.

        Physics repeats the drive before the first one.
        """
        from groundlink.recording.reader import Recording
        from groundlink.recording.repeated_run import resimulate, write_drive

        with Recording(self.recording) as recording, progress(f"writing {to}") as show:
            if not self._file.exists():
                write_drive(recording, self._file)
            resimulate(recording, scenario, to, drive=self._file, show=show)
        with Recording(to) as written:
            return 0 if all(map(keeps_rate, written.topics.values())) else 1


@contextmanager
def _folder(out: Path | None) -> Iterator[Path]:
    """Yield the folder of the recordings: the given one, or one that is removed."""
    if out:
        if out.exists():
            raise UserError(f"--out {out}: file exists. Fix: choose another name")
        out.mkdir(parents=True)
        yield out
        return
    with tempfile.TemporaryDirectory(prefix="groundlink-sweep-") as name:
        yield Path(name)


def _columns(rows: Sequence[Row]) -> list[str]:
    return list(dict.fromkeys(name for row in rows for name in row))


def _cells(row: Row) -> dict[str, str]:
    """Return a row as text."""
    return {name: _text(value) for name, value in row.items()}


def _text(value: Any) -> str:
    if isinstance(value, str):
        return value
    return f"{value:.5g}" if isinstance(value, float) else json.dumps(value)


def _write_csv(file: Path, rows: Sequence[Row]) -> None:
    with write_atomically(file) as part, part.open("w", newline="", encoding="utf-8") as opened:
        writer = csv.DictWriter(opened, _columns(rows))
        writer.writeheader()
        writer.writerows(map(_cells, rows))


def _show(console: Console, title: str, rows: Sequence[Row], varied: int) -> None:
    """Print the table: the changed fields, the check, and the figures that differ."""
    names = _columns(rows)
    same = [n for n in names[varied:] if all(row.get(n) == rows[0].get(n) for row in rows)]
    shown = [name for name in names if name not in same or name == CHECK]
    columns = [Column(name, "words" if name == CHECK else "number") for name in shown]
    table = FittingTable(title, columns)
    for cells in map(_cells, rows):
        table.add_row(*(cells.get(name, "-") for name in shown))
    console.print(table)


def _sweep_experiment(options: argparse.Namespace) -> int:
    if not (REPOSITORY / "experiments").is_dir():
        raise UserError(
            "sweep: the experiments are not installed. Fix: run it in a clone of the repository"
        )
    if options.check or options.duration:
        raise UserError("sweep: --check and --duration apply to scenarios, not with --vary")
    words = [options.scenario, *(word for text in options.vary for word in ("--vary", text))]
    words += ["--short"] if options.short else []
    for name, value in (("--seeds", options.seeds), ("--out", options.out)):
        words += [name, str(value)] if value else []
    path = os.pathsep.join(filter(None, (str(REPOSITORY), os.environ.get("PYTHONPATH"))))
    return exit_code(
        [sys.executable, "-m", EXPERIMENTS, *words], env=os.environ | {"PYTHONPATH": path}
    )
