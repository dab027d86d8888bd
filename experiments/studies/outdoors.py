# SPDX-License-Identifier: Apache-2.0
"""Section 6.4 of the paper: a tank on a road through a hamlet, with LiDAR and IMU or a camera."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from experiments.estimation.estimators import (
    GICP,
    LIDAR_INERTIAL,
    compare_estimators,
    run_estimator,
)
from experiments.estimation.evaluation import Evaluation
from experiments.estimation.vocabulary import INDOORS
from experiments.experiment import ExperimentOptions, record_setup
from experiments.recording.setups import Changes, Setup, shipped, waypoints

from .pictures import CameraStudy, orb_slam3

SCENARIO = "outdoor_paper"
CLOUDS: Changes = {"camera": None, "gnss": None}
CAMERA: Changes = {"lidar": None, "gnss": None, "camera": {"rate_hz": 30.0}}

SECONDS = 75.0
"""170 m."""

LAP_SECONDS = 156.0
"""370 m, and back where it began."""

SHORT_SECONDS = 12.0

OPEN_COUNTRY = (
    "--set=hybrid_metric.enable=0",
    "--set=adaptive_voxelization.enable=0",
    "--set=mapping.planar_threshold=0.01",
)
"""What genz-lio is told beside its settings for a Velodyne. From a road a LiDAR sees mostly ground,
in rings that go with the vehicle: points matched to points of the map say that it stands, and
thinning for a room leaves too little of houses and trees. The threshold is that of the program's
own settings for a VLP-16 in the field."""

IN_OPEN_COUNTRY = replace(LIDAR_INERTIAL, settings=(*LIDAR_INERTIAL.settings, *OPEN_COUNTRY))

TALL_GRASS: dict[str, Any] = {
    "ground": ["grass", "meadow", "stubble"],
    "height_m": [0.3, 0.7],
    "leaf_area_density_per_m": 5.0,
}
"""As a meadow before it is mown, with a leaf area index of 2.5; it stands beside the road."""

LIMIT_M = 0.4
CAMERA_LIMIT_SHARE = 0.01
"""Of the way."""

CRAWL_M = 0.3
"""On which the tank is for 3 to 4 s; it slides a hand's breadth while it comes to rest."""

FIRST_FRAME_S = 6.0
"""When the tank has begun to move."""


def road(speed_mps: float | None = None) -> dict[str, Any]:
    """Return the way of the shipped scenario, begun at a crawl, at its own speed or another."""
    vehicle = shipped(SCENARIO)["vehicles"][0]
    route = vehicle["route"]
    speed_mps = speed_mps or route["speed_mps"]
    return waypoints(vehicle["placement"], route["points"], speed_mps, CRAWL_M)


def lidar(options: ExperimentOptions) -> Sequence[Evaluation]:
    """Run odometry by LiDAR and IMU, and by LiDAR alone, over 170 m of the road (6.4)."""
    setup = drive(options, "outdoor_lidar", SECONDS, CLOUDS)
    return compare_estimators(options, setup, {IN_OPEN_COUNTRY: LIMIT_M, GICP: 0.0})


def grass(options: ExperimentOptions) -> Sequence[Evaluation]:
    """Run the same odometry over 170 m, between lawns and between tall grass (6.4)."""
    world = shipped("worlds/rural")
    bare = drive(options, "outdoor_grass", SECONDS, CLOUDS)
    results = []
    for seed in options.seeds:
        for case, areas in (("lawn", []), ("tall grass", [TALL_GRASS])):
            setup = replace(bare, seed=seed, top={"world": world | {"grass": areas}})
            recording = record_setup(options, setup)
            for estimator in (IN_OPEN_COUNTRY, GICP):
                result, _ = run_estimator(
                    options, estimator, recording, experiment=bare.name, case=case
                )
                results.append(result)
    return results


def lap(options: ExperimentOptions) -> Sequence[Evaluation]:
    """Run the same odometry over a closed lap of 370 m (6.4).

    The result is how far the end is from the start.
    """
    setup = drive(options, "outdoor_lap", LAP_SECONDS, CLOUDS)
    return compare_estimators(options, setup, {IN_OPEN_COUNTRY: LIMIT_M, GICP: 0.0})


def mono(options: ExperimentOptions) -> Sequence[Evaluation]:
    """Run ORB-SLAM3 on one camera at 30 Hz, given in real time, over 170 m (6.4)."""
    pictures = CameraStudy(
        setup=drive(options, "outdoor_mono", SECONDS, CAMERA),
        scenes=INDOORS,
        from_s=FIRST_FRAME_S,
        limit_m=lambda recording: CAMERA_LIMIT_SHARE * recording.truth().length_m,
    )
    return orb_slam3(options, pictures)


def drive(options: ExperimentOptions, name: str, seconds: float, sensors: Changes) -> Setup:
    """Return the tank's drive."""
    return Setup(
        name=name,
        scenario=SCENARIO,
        seconds=SHORT_SECONDS if options.short else seconds,
        sensors=sensors,
        vehicle={"route": road()},
    )
