# SPDX-License-Identifier: Apache-2.0
r"""`groundlink sweep EXPERIMENT --vary SENSOR.FIELD=[A, B] ... [--seeds N] [--short] [--out DIR]`.

Repeats an experiment for each combination of what is varied, and tables the errors: which sensor,
and where on the vehicle. Fields are those of the scenario, values are YAML:

    groundlink sweep indoor_scans --vary 'scanner.mount=[lidar, {xyz_m: [0.2, 0.0, 0.9]}]'
    groundlink sweep indoor_scans \
        --vary 'scanner.datasheet=[sensors/utm30lx.yaml, sensors/lms111.yaml]'
"""

import argparse
import itertools
import json
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from experiments.estimation.evaluation import Evaluation, write_csv
from experiments.experiment import OUT, ExperimentOptions
from experiments.output.console import Console
from experiments.output.page import table_of
from experiments.table import EXPERIMENTS
from groundlink.core.errors import UserError

FORM = "SENSOR.FIELD=[A, B, ...], such as scanner.mount=[lidar, {xyz_m: [0.2, 0.0, 0.9]}]"


@dataclass(frozen=True)
class Varied:
    """A field of a sensor, and the values that it takes in turn."""

    sensor: str
    field: str
    values: tuple[Any, ...]

    def words(self, value: Any) -> str:
        """Return in words that it has a value."""
        short = Path(value).stem if isinstance(value, str) else json.dumps(value)
        return f"{self.sensor}.{self.field} {short}"


def varied(text: str) -> Varied:
    """Return what an argument `--vary` means.

    Raises
    ------
    UserError
        when it has another form.
    """
    found = re.fullmatch(r"(\w+)\.(\w+)=(.*)", text, re.DOTALL)
    try:
        values = yaml.safe_load(found[3]) if found else None
    except yaml.YAMLError:
        values = None
    if not found or not isinstance(values, list) or not values:
        raise UserError(f"--vary {text}: expected {FORM}")
    return Varied(found[1], found[2], tuple(values))


def cases(rows: Sequence[Varied]) -> dict[str, dict[str, dict[str, Any]]]:
    """Return each combination: in words, and as fields by sensor."""
    found = {}
    for values in itertools.product(*(row.values for row in rows)):
        pairs = list(zip(rows, values, strict=True))
        sensors: dict[str, dict[str, Any]] = {}
        for row, value in pairs:
            sensors.setdefault(row.sensor, {})[row.field] = value
        found[", ".join(row.words(value) for row, value in pairs)] = sensors
    return found


def sweep(
    name: str, options: ExperimentOptions, over: Mapping[str, Mapping[str, Any]]
) -> list[Evaluation]:
    """Return the results of an experiment in each case; nothing is asked of them."""
    results = []
    for number, (words, vary) in enumerate(over.items(), 1):
        options.console.print(f"{name}, {number} of {len(over)}: {words}")
        drawn = f"figures/sweep/{re.sub(r'[^a-z0-9]+', '_', words.lower()).strip('_')}"
        for result in EXPERIMENTS[name].run(replace(options, vary=vary, figures=drawn)):
            case = f"{words}; {result.case}" if result.case else words
            results.append(replace(result, case=case, limit_m=0.0))
    return results


def main(arguments: Sequence[str]) -> int:
    """Sweep, write the table, print it."""
    parser = argparse.ArgumentParser(
        prog="groundlink sweep",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("experiment", choices=EXPERIMENTS, metavar="EXPERIMENT")
    parser.add_argument("--vary", action="append", required=True, metavar="SENSOR.FIELD=[...]")
    parser.add_argument("--seeds", type=int, default=1, metavar="N", help="runs each (1)")
    parser.add_argument("--short", action="store_true", help="twenty seconds of driving")
    parser.add_argument("--out", type=Path, default=OUT, help="where all goes (%(default)s)")
    given = parser.parse_args(arguments)
    try:
        over = cases([varied(text) for text in given.vary])
        seeds = tuple(range(1, given.seeds + 1))
        options = ExperimentOptions(given.out.resolve(), Console(), seeds, given.short)
        results = sweep(given.experiment, options, over)
    except UserError as error:
        print(f"groundlink sweep: {error}", file=sys.stderr)
        return error.exit_code
    file = options.folder("tables", "sweeps") / f"{given.experiment}.csv"
    write_csv(file, results)
    print("\n".join(table_of(results)))
    options.console.print(f"wrote {file}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
