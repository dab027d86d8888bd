# SPDX-License-Identifier: Apache-2.0
"""Experiment: its description, its options, and the evaluation of its estimates."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from experiments.estimation.evaluation import Evaluation, evaluate
from experiments.output.console import Console
from experiments.recording.recordings import RecordedRun, record
from experiments.recording.setups import Changes, Setup
from groundlink.data.trajectory import Trajectory, read_tum

OUT = Path("build/experiments")
"""Default output folder."""


@dataclass(frozen=True)
class ExperimentOptions:
    """Options of an experiment from the command line."""

    out: Path
    """Folder of recordings, environments, tables and figures."""

    console: Console
    seeds: tuple[int, ...] = (1, 2, 3)
    short: bool = False
    """A few seconds of driving, without limits, for tests."""

    vary: Mapping[str, Changes] = field(default_factory=dict)
    """Changed fields of sensors, by name."""

    figures: str = "figures"
    """Folder of figures below `out`."""

    def folder(self, *names: str) -> Path:
        """Return a folder below `out`, created if missing."""
        folder = self.out.joinpath(*names)
        folder.mkdir(parents=True, exist_ok=True)
        return folder

    def figure(self, name: str) -> Path:
        """Return the file of a figure."""
        return self.folder(self.figures) / f"{name}.png"


@dataclass(frozen=True)
class Experiment:
    """A row of the table."""

    run: Callable[[ExperimentOptions], Sequence[Evaluation]]
    minutes: float
    """Duration on two cores, with environments installed and nothing recorded."""

    @property
    def what(self) -> str:
        """Return the first line of the docstring of `run`; "(6.1)" is a section of the paper."""
        return (self.run.__doc__ or "").partition("\n")[0].removesuffix(".")


@dataclass(frozen=True)
class AlignedEstimate:
    """An estimated trajectory with the truth at the same times."""

    label: str
    truth: Trajectory
    estimate: Trajectory
    """Aligned with the truth."""

    raw: Trajectory
    """In the map frame of the program."""


def record_setup(options: ExperimentOptions, setup: Setup) -> RecordedRun:
    """Return the recording of a setup with the options' changes; see `record`."""
    return record(setup.varied(options.vary), options.out, options.console)


def evaluate_estimate(
    options: ExperimentOptions,
    recording: RecordedRun,
    tum: Path,
    *,
    frame: str,
    experiment: str,
    program: str,
    case: str = "",
    took_s: float = 0.0,
    limit_m: float = 0.0,
    limit_over_100_m: float = 0.0,
    scale: bool = False,
) -> tuple[Evaluation, AlignedEstimate]:
    """Evaluate a program's estimate on a recording.

    Parameters
    ----------
    tum
        its estimate, of `frame`.
    scale
        align by Sim(3), for estimates without scale.
    """
    truth = recording.truth(frame)
    errors, matched, aligned = evaluate(truth, tum, options.out, options.console, scale=scale)
    result = Evaluation(
        experiment=experiment,
        program=program,
        case=case,
        seed=recording.seed,
        ate_m=errors["ate_m"],
        largest_m=errors["largest_m"],
        start_to_end_m=errors["start_to_end_m"],
        way_m=errors["way_m"],
        poses=int(errors["poses"]),
        scale=errors["scale"],
        took_s=took_s,
        limit_m=0.0 if options.short else limit_m,
        over_100_m=errors["over_100_m"],
        limit_over_100_m=0.0 if options.short else limit_over_100_m,
    )
    options.console.print(
        f"{experiment}, {program} {case}, seed {result.seed}: ATE {100 * result.ate_m:.2f} cm, "
        f"start to end {100 * result.start_to_end_m:.2f} cm over {result.way_m:.1f} m, "
        f"{f'{result.over_100_m:.2%} over 100 m, ' if result.over_100_m else ''}"
        f"{result.poses} poses"
    )
    return result, AlignedEstimate(f"{program} {case}".strip(), matched, aligned, read_tum(tum))
