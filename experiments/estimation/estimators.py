# SPDX-License-Identifier: Apache-2.0
"""Estimators: run an external program on a recording and evaluate its trajectory."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from experiments.experiment import (
    AlignedEstimate,
    ExperimentOptions,
    evaluate_estimate,
    record_setup,
)
from experiments.output import figures
from experiments.recording.recordings import RecordedRun
from experiments.recording.setups import Setup

from . import environments
from .evaluation import Evaluation
from .programs import GENZ_LIO, KISS_ICP, RKO_LIO, SMALL_GICP, YAG_SLAM, ExternalProgram


@dataclass(frozen=True)
class Estimator:
    """An external program with its settings."""

    program: ExternalProgram
    frame: str
    """Frame of the estimated trajectory."""

    settings: tuple[str, ...] = ()
    """Options of its driver."""

    knows_scale: bool = True
    takes_imu: bool = False

    def with_lidar(self, topic: str, frame: str) -> "Estimator":
        """Return the estimator on the clouds of another LiDAR."""
        mount = ("--lidar-frame", frame) if self.takes_imu else ()
        return replace(
            self,
            frame=frame if self.frame == LIDAR_FRAME else self.frame,
            settings=(*self.settings, "--lidar-topic", topic, *mount),
        )


LIDAR_FRAME = "lidar_link"

AT_REST_S = 1.0
"""By then a vehicle is at rest on its springs."""

LIDAR_INERTIAL = Estimator(GENZ_LIO, "imu_link", ("--from-s", str(AT_REST_S)), takes_imu=True)
RKO = Estimator(RKO_LIO, LIDAR_FRAME, takes_imu=True)
KISS = Estimator(KISS_ICP, LIDAR_FRAME)
GICP = Estimator(SMALL_GICP, LIDAR_FRAME)
SLAM_2D = Estimator(YAG_SLAM, "scan_link")


def tum_of(
    options: ExperimentOptions,
    estimator: Estimator,
    recording: RecordedRun,
    experiment: str,
    case: str = "",
) -> Path:
    """Return the file of an estimate; other output of the program is beside it."""
    words = "_".join([estimator.program.name, *case.replace("%", "").split()])
    return options.folder("runs", recording.folder.name) / f"{experiment}_{words}.tum"


def run_estimator(
    options: ExperimentOptions,
    estimator: Estimator,
    recording: RecordedRun,
    *,
    experiment: str,
    case: str = "",
    more: Sequence[str] = (),
    bag: Path | None = None,
    limit_m: float = 0.0,
    limit_over_100_m: float = 0.0,
) -> tuple[Evaluation, AlignedEstimate]:
    """Run a program on a recording and evaluate its estimate.

    Parameters
    ----------
    more
        options of its driver, beside its settings.
    bag
        bag instead of that of the recording.
    """
    tum = tum_of(options, estimator, recording, experiment, case)
    began_s = time.monotonic()
    environments.run(
        estimator.program,
        [bag or recording.bag, tum, *estimator.settings, *more],
        options.out,
        options.console,
        label=f"{experiment}, seed {recording.seed} {case}".strip(),
        log=tum.with_suffix(".log"),
    )
    return evaluate_estimate(
        *(options, recording, tum),
        frame=estimator.frame,
        experiment=experiment,
        program=estimator.program.name,
        case=case,
        took_s=time.monotonic() - began_s,
        limit_m=limit_m,
        limit_over_100_m=limit_over_100_m,
        scale=not estimator.knows_scale,
    )


def compare_estimators(
    options: ExperimentOptions, setup: Setup, limits: Mapping[Estimator, float]
) -> list[Evaluation]:
    """Run programs on a drive for each seed; draw the first seed.

    Parameters
    ----------
    limits
        largest accepted ATE (m) of each program; 0 for none.
    """
    results = []
    for seed in options.seeds:
        recording = record_setup(options, replace(setup, seed=seed))
        done = [
            run_estimator(options, estimator, recording, experiment=setup.name, limit_m=limit_m)
            for estimator, limit_m in limits.items()
        ]
        results += [result for result, _ in done]
        if seed == options.seeds[0]:
            figures.trajectories(
                options.figure(setup.name), recording.scenario, [way for _, way in done]
            )
    return results
