# SPDX-License-Identifier: Apache-2.0
"""Section 6.2 of the paper: accumulated error on a track of 15 m, there and back.

An ideal LiDAR and one with the errors of its data sheet measure the same drive. A second, fast
drive outdoors shows the effect of the duration of a sweep.
"""

from collections.abc import Mapping, Sequence
from dataclasses import astuple, fields
from typing import Any

from experiments.estimation.checkpoints import CheckpointError, accumulated_errors
from experiments.estimation.estimators import GICP, KISS, LIDAR_INERTIAL, run_estimator
from experiments.estimation.evaluation import Evaluation, write_rows
from experiments.experiment import ExperimentOptions, record_setup
from experiments.output import figures
from experiments.recording.setups import Setup, waypoints

from .outdoors import road

SECONDS = 60.0
SHORT_SECONDS = 14.0

IDEAL: Mapping[str, Any] = {
    "range_stddev_m": 0.0,
    "laser_bias_m": 0.0,
    "range_resolution_m": 0.0,
}
"""What makes a LiDAR of its data sheet one without error."""

LIDARS = {"ideal": ("/points/ideal", "ideal_link"), "data sheet": ("/points", "lidar_link")}
"""Topic and frame."""

CRAWL_M = 0.1
"""2 s."""

FAST_MPS = 4.0
FAST_SECONDS = 40.0


def there_and_back(half_m: float, speed_mps: float, laps: int = 1) -> dict[str, Any]:
    """Return the way from one end of a track along x to the other and back, begun at a crawl."""
    ends = [{"x_m": half_m, "y_m": 0.0}, {"x_m": -half_m, "y_m": 0.0}]
    return waypoints({"x_m": -half_m, "y_m": 0.0, "yaw_deg": 0.0}, ends * laps, speed_mps, CRAWL_M)


def checkpoints(options: ExperimentOptions) -> Sequence[Evaluation]:
    """Sum squared distances at checkpoints, for two LiDARs (6.2)."""
    results = []
    curves: dict[str, list[CheckpointError]] = {}
    for seed in options.seeds:
        setup = Setup(
            name="track",
            scenario="track",
            seconds=SHORT_SECONDS if options.short else SECONDS,
            seed=seed,
            vehicle={"route": there_and_back(7.5, 0.6)},
            sensors={
                "scanner": None,
                "odometry": None,
                "encoders": None,
                "lidar": {"datasheet": "sensors/vlp16.yaml"},
                "ideal": {
                    "kind": "lidar",
                    "datasheet": "sensors/vlp16.yaml",
                    "topic": LIDARS["ideal"][0],
                    "frame": LIDARS["ideal"][1],
                    "mount": "mast",
                    **IDEAL,
                },
            },
        )
        recording = record_setup(options, setup)
        checkpoints_m = recording.scenario.world.checkpoints
        for program in (LIDAR_INERTIAL, KISS, GICP):
            for case, (topic, frame) in LIDARS.items():
                estimator = program.with_lidar(topic, frame)
                result, way = run_estimator(
                    options, estimator, recording, experiment="track", case=case
                )
                results.append(result)
                passed = accumulated_errors(
                    way.raw, recording.truth(estimator.frame), recording.truth(), checkpoints_m
                )
                curves[f"{result.program}, {case}, seed {seed}"] = passed
                last = passed[-1]
                options.console.print(
                    f"track, {result.program}, {case}, seed {seed}: {last.sum_mm2:.0f} mm2 after "
                    f"{last.travelled_m:.1f} m"
                )
    _write(options, curves)
    return results


def _write(options: ExperimentOptions, curves: Mapping[str, Sequence[CheckpointError]]) -> None:
    write_rows(
        options.folder("tables") / "track_checkpoints.csv",
        ["run", *(field.name for field in fields(CheckpointError))],
        [
            [name, *(f"{v:.5g}" if isinstance(v, float) else v for v in astuple(one))]
            for name, passed in curves.items()
            for one in passed
        ],
    )
    figures.accumulated_errors(options.figure("track"), curves)


SHUTTERS: dict[str, tuple[str, tuple[str, ...]]] = {
    "swept, as it is": ("/points/ideal", ("--sweeps", "as-they-are")),
    "swept, corrected by the last motion": ("/points/ideal", ()),
    "instantaneous": ("/points/ideal/truth", ("--sweeps", "instantaneous")),
}
"""By case: the topic, and options of the driver."""


def shutter(options: ExperimentOptions) -> Sequence[Evaluation]:
    """Compare sweeps of a fast drive with instantaneous pictures (6.2), without range errors."""
    setup_sensors: Mapping[str, Any] = {
        "camera": None,
        "gnss": None,
        "lidar": None,
        "imu": None,
        "ideal": {
            "kind": "lidar",
            "datasheet": "sensors/vlp16.yaml",
            "topic": LIDARS["ideal"][0],
            "frame": "lidar_link",
            "mount": "mast",
            "truth": True,
            **IDEAL,
        },
    }
    results = []
    for seed in options.seeds:
        setup = Setup(
            name="shutter",
            scenario="outdoor_paper",
            seconds=SHORT_SECONDS if options.short else FAST_SECONDS,
            seed=seed,
            sensors=setup_sensors,
            vehicle={"route": road(FAST_MPS)},
        )
        recording = record_setup(options, setup)
        for estimator in (GICP, KISS):
            for case, (topic, more) in SHUTTERS.items():
                result, _ = run_estimator(
                    *(options, estimator, recording),
                    experiment="shutter",
                    case=case,
                    more=("--lidar-topic", topic, *more),
                )
                results.append(result)
    return results
