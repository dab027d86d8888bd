# SPDX-License-Identifier: Apache-2.0
"""Evaluation of trajectories against the ground truth, by evo.

The truth is interpolated to the times of the estimate, so that time errors do not count as position
errors. Both trajectories are of the same frame.
"""

import csv
import json
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import msgspec

from experiments.output.console import Console
from groundlink.data.trajectory import Trajectory, read_tum, write_tum

from . import environments
from .programs import EVO


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """Errors of one program on one recording."""

    experiment: str
    program: str
    case: str
    """What differs between runs of the same program: `mono`, `odometry alone` ..."""

    seed: int
    ate_m: float
    """RMSE of positions after the alignment."""

    largest_m: float
    start_to_end_m: float
    """Error of the displacement from the first pose to the last, after alignment."""

    way_m: float
    """Length of the true path between the first pose and the last."""

    poses: int
    scale: float
    """Scale applied to the estimate; 1 without scale alignment."""

    took_s: float
    """Wall-clock time of the program."""

    limit_m: float = 0.0
    """Largest ATE that is accepted; 0 for none."""

    over_100_m: float = 0.0
    """Mean error of the motion over 100 m of the path, as a share; 0 where the path is shorter."""

    limit_over_100_m: float = 0.0
    """Largest `over_100_m` that is accepted; 0 for none."""


def evaluate(
    truth: Trajectory,
    estimate_tum: Path,
    out: Path,
    console: Console,
    *,
    scale: bool = False,
) -> tuple[dict[str, float], Trajectory, Trajectory]:
    """Return errors by name of `Evaluation`, and the truth and the aligned estimate at its times.

    Raises
    ------
    UserError
        when there is no estimate.
    """
    estimate = read_tum(estimate_tum)
    matched = truth.at(estimate.seconds)
    reference = estimate_tum.with_suffix(".truth.tum")
    aligned = estimate_tum.with_suffix(".aligned.tum")
    write_tum(reference, matched)
    printed = environments.run(
        EVO,
        [reference, estimate_tum, *(["--scale"] if scale else []), "--out", aligned],
        out,
        console,
        label=estimate_tum.stem,
        log=estimate_tum.with_suffix(".evo.log"),
    )
    errors: dict[str, float] = json.loads(printed.strip().splitlines()[-1])
    return errors, matched, read_tum(aligned)


def write_csv(file: Path, results: Iterable[Evaluation]) -> None:
    """Write results as a table."""
    with file.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.DictWriter(stream, [field.name for field in fields(Evaluation)])
        writer.writeheader()
        for result in results:
            row = asdict(result)
            writer.writerow({k: f"{v:.5g}" if isinstance(v, float) else v for k, v in row.items()})


def write_rows(file: Path, head: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a table of another kind."""
    with file.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(head)
        writer.writerows(rows)


def read_csv(file: Path) -> list[Evaluation]:
    """Return results as they were written."""
    with file.open(encoding="utf-8", newline="") as stream:
        return msgspec.convert([*csv.DictReader(stream)], list[Evaluation], strict=False)


def median(results: Sequence[Evaluation], what: str = "ate_m") -> float:
    """Return the median over seeds of a figure."""
    return float(statistics.median(getattr(result, what) for result in results))


def missed(results: Sequence[Evaluation]) -> list[str]:
    """Return the exceeded limits as text; each applies to the median over seeds."""
    groups: dict[tuple[str, str, str], list[Evaluation]] = {}
    for result in results:
        groups.setdefault((result.experiment, result.program, result.case), []).append(result)
    found = []
    for (experiment, program, case), group in groups.items():
        what = f"{experiment}, {program} {case}"
        error_m, limit_m = median(group), group[0].limit_m
        if limit_m and not error_m < limit_m:
            found.append(f"{what}: {error_m:.4f} m, expected below {limit_m:g} m")
        share, limit = median(group, "over_100_m"), group[0].limit_over_100_m
        if limit and not 0 < share < limit:
            found.append(f"{what}: {share:.2%} over 100 m, expected below {limit:.2%}")
    return found
