# SPDX-License-Identifier: Apache-2.0
"""Experiment: its description, its options, and the evaluation of its estimates."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from experiments.estimation.evaluation import Evaluation, evaluate
from experiments.estimation.trajectories import Trajectory, read_tum
from experiments.output.console import Console
from experiments.recording.recordings import RecordedRun, record
from experiments.recording.setups import Changes, Setup

OUT = Path("build/experiments")
"""Where all goes, unless somebody says otherwise."""


@dataclass(frozen=True)
class ExperimentOptions:
    """What the command line asks of an experiment."""

    out: Path
    """Where recordings, environments, tables and figures go."""

    console: Console
    seeds: tuple[int, ...] = (1, 2, 3)
    short: bool = False
    """Some seconds of driving instead of all, without limits: for tests."""

    vary: Mapping[str, Changes] = field(default_factory=dict)
    """Sensors, by name, with fields that are other than the experiment has them."""

    figures: str = "figures"
    """Where figures go, below `out`."""

    def folder(self, *names: str) -> Path:
        """Return a folder below `out`, which is made."""
        folder = self.out.joinpath(*names)
        folder.mkdir(parents=True, exist_ok=True)
        return folder

    def figure(self, name: str) -> Path:
        """Return the file of a figure."""
        return self.folder(self.figures) / f"{name}.png"


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """A row of the table."""

    what: str
    run: Callable[[ExperimentOptions], Sequence[Evaluation]]
    minutes: float
    """On two cores, environments made and nothing recorded yet."""


@dataclass(frozen=True)
class AlignedEstimate:
    """A way for a figure: what was estimated, over the truth at the same times."""

    label: str
    truth: Trajectory
    estimate: Trajectory
    """Aligned with the truth."""

    raw: Trajectory
    """As the program had it, in the frame of its map."""


def record_setup(options: ExperimentOptions, setup: Setup) -> RecordedRun:
    """Return the recording of a setup, varied as asked; see `record`."""
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
    scale: bool = False,
) -> tuple[Evaluation, AlignedEstimate]:
    """Return how well a program did on a recording.

    Parameters
    ----------
    tum
        its estimate, of `frame`.
    scale
        align by Sim(3), for what cannot know its scale.
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
    )
    options.console.print(
        f"{experiment}, {program} {case}, seed {result.seed}: ATE {100 * result.ate_m:.2f} cm, "
        f"start to end {100 * result.start_to_end_m:.2f} cm over {result.way_m:.1f} m, "
        f"{result.poses} poses"
    )
    return result, AlignedEstimate(f"{program} {case}".strip(), matched, aligned, read_tum(tum))
