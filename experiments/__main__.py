# SPDX-License-Identifier: Apache-2.0
"""`python -m experiments [NAME ...] [--short] [--seeds N] [--out DIR] [--list] [--install NAME]`.

Runs experiments, writes a table (CSV) of each, its figures (PNG), and a page of all, and says which
limits were not kept; the exit code is 1 then. One that cannot be run keeps none of the others from
it; the exit code is 2 then. What is recorded once is used again as long as neither the scenario nor
the sources of the simulator change. `--install` installs a program that experiments use, and runs
none.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from experiments.estimation.environments import python_of
from experiments.estimation.evaluation import missed, write_csv
from experiments.estimation.programs import PROGRAMS
from experiments.output.console import Console
from experiments.output.page import write_report
from groundlink.core.errors import UserError

from .experiment import OUT, ExperimentOptions
from .table import EXPERIMENTS, SHORT


def main(arguments: Sequence[str]) -> int:
    """Run experiments; 0 when all could be run and all limits are kept."""
    parser = argparse.ArgumentParser(prog="python -m experiments", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="which (default: all)")
    parser.add_argument("--short", action="store_true", help="one seed, 12 s of driving, no limits")
    parser.add_argument("--seeds", type=int, default=3, metavar="N", help="runs each (3)")
    parser.add_argument("--out", type=Path, default=OUT, help="where all goes (%(default)s)")
    parser.add_argument("--list", action="store_true", help="list the experiments")
    parser.add_argument(
        "--install",
        action="append",
        choices=sorted(PROGRAMS),
        metavar="NAME",
        help="install a program that experiments use, and run nothing; may be repeated",
    )
    options = parser.parse_args(arguments)
    if options.list:
        for name, experiment in EXPERIMENTS.items():
            print(f"{name:20} {experiment.minutes:3g} min  {experiment.what}")
        return 0
    if unknown := [name for name in options.names if name not in EXPERIMENTS]:
        known = ", ".join(EXPERIMENTS)
        print(f"no experiment {', '.join(unknown)}; expected some of {known}", file=sys.stderr)
        return UserError.exit_code
    if options.seeds < 1:
        print(f"--seeds {options.seeds}: expected 1 or more", file=sys.stderr)
        return UserError.exit_code
    seeds = tuple(range(1, 2 if options.short else options.seeds + 1))
    console = Console()
    if options.install:
        return _install(options.install, options.out, console)
    given = ExperimentOptions(options.out.resolve(), console, seeds, options.short)
    failed: list[str] = []
    code = 0
    for name in options.names or (SHORT if options.short else EXPERIMENTS):
        experiment = EXPERIMENTS[name]
        console.print(f"{name}: {experiment.what}; about {experiment.minutes:g} minutes")
        try:
            results = experiment.run(given)
        except UserError as error:
            console.print(f"{name}: {error}")
            failed.append(f"{name}, not run to its end")
            code = error.exit_code
            continue
        if results:
            write_csv(given.folder("tables") / f"{name}.csv", results)
        console.print(f"{name}: done; see {write_report(given.out)}")
        failed += missed(results)
    for line in failed:
        print(f"not kept: {line}", file=sys.stderr)
    return code or (1 if failed else 0)


def _install(names: Sequence[str], out: Path, console: Console) -> int:
    """Install programs, each into its environment; 0 when all are there."""
    for name in names:
        try:
            python_of(PROGRAMS[name], out, console)
        except UserError as error:
            print(error, file=sys.stderr)
            return error.exit_code
    return 0


if __name__ == "__main__":
    try:
        raise SystemExit(main(sys.argv[1:]))
    except KeyboardInterrupt:
        print("\nended; what was recorded whole is kept", file=sys.stderr)
        raise SystemExit(130) from None
