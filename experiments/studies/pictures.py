# SPDX-License-Identifier: Apache-2.0
"""ORB-SLAM3 on a drive with a camera."""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from experiments.estimation.estimators import Estimator, run_estimator, tum_of
from experiments.estimation.evaluation import Evaluation
from experiments.estimation.programs import ORB_SLAM3
from experiments.estimation.vocabulary import vocabulary
from experiments.experiment import ExperimentOptions, record_setup
from experiments.output import figures
from experiments.recording.recordings import RecordedRun
from experiments.recording.setups import Setup

FRAME = "camera_optical_frame"

LOST_S = 5.0
"""Of a drive, after which who begins a new map has lost the old one: the error counts as infinite,
however good the map of the rest is."""


@dataclass(frozen=True, kw_only=True)
class CameraStudy:
    """A drive with a camera, and how ORB-SLAM3 takes it."""

    setup: Setup
    scenes: Setup
    """What its vocabulary is trained from; see `vocabulary`."""

    from_s: float
    """Stamp of the first frame that is given: when the vehicle has begun to move, since from one
    camera that stands nothing can be learned."""

    limit_m: Callable[[RecordedRun], float]
    words: tuple[str, ...] = ()
    """Options of the driver."""

    has_depth: bool = False
    """Without, an estimate cannot know its scale."""


def orb_slam3(options: ExperimentOptions, pictures: CameraStudy) -> Sequence[Evaluation]:
    """Run it for each seed; draw the first."""
    name, case = pictures.setup.name, "RGB-D" if pictures.has_depth else "mono"
    trained = vocabulary(options, pictures.scenes)
    settings = ("--vocabulary", str(trained), "--from-s", str(pictures.from_s), *pictures.words)
    slam = Estimator(ORB_SLAM3, FRAME, settings, knows_scale=pictures.has_depth)
    results = []
    for seed in options.seeds:
        recording = record_setup(options, replace(pictures.setup, seed=seed))
        limit_m = pictures.limit_m(recording)
        result, way = run_estimator(
            options, slam, recording, experiment=name, case=case, limit_m=limit_m
        )
        tum = tum_of(options, slam, recording, name, case)
        told = json.loads(tum.with_suffix(".json").read_text(encoding="utf-8"))
        words = ", ".join(f"{what} {number:.5g}" for what, number in told.items())
        options.console.print(f"{name}, seed {seed}: {words}")
        if told["map_begun_s"] > LOST_S:
            options.console.print(
                f"{name}, seed {seed}: lost; a new map after {told['map_begun_s']:.0f} s"
            )
            result = replace(result, ate_m=math.inf)
        results.append(result)
        if seed == options.seeds[0]:
            figures.trajectories(options.figure(name), recording.scenario, [way])
    return results
