# SPDX-License-Identifier: Apache-2.0
"""Odometry by LiDARs of several patterns on one mount, so that all of them measure one drive."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from experiments.estimation.estimators import (
    GICP,
    KISS,
    LIDAR_INERTIAL,
    RKO,
    Estimator,
    run_estimator,
)
from experiments.estimation.evaluation import Evaluation
from experiments.experiment import ExperimentOptions, record_setup
from experiments.recording.setups import Setup

from . import indoors, outdoors

SHEETS = {"VLP-16": "vlp16", "XT-32": "xt32", "OS1-64": "os1_64", "Mid-360": "mid360"}
"""Data sheet of each LiDAR."""

ROAD = ("VLP-16", "XT-32", "OS1-64")
ROOM = ("VLP-16", "XT-32", "OS1-64", "Mid-360")
"""LiDARs on a vehicle. The range of a Mid-360 on a target of 10 % is 40 m."""

ROOM_SECONDS = 45.0
"""Three quarters of a lap."""

DEFAULTS = {"OS1-64": 0.01, "VLP-16": 0.0}
"""LiDARs of the comparison of default settings, with the largest accepted share of the path."""

LIMITS_M: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "room": {
        "VLP-16": (0.15, 0.04),
        "XT-32": (0.12, 0.02),
        "OS1-64": (0.12, 0.04),
        "Mid-360": (0.12, 0.03),
    },
    "road": {"XT-32": (0.0, 0.0)},
}
"""Largest accepted ATE of KISS-ICP and of genz-lio: twice that of a run with seed 1, rounded up to
whole centimeters. The road with the other LiDARs is that of the default settings."""


def defaults(options: ExperimentOptions) -> Sequence[Evaluation]:
    """Run four odometries with their default settings on 170 m of road (6.4)."""
    results = []
    for seed in options.seeds:
        recording = record_setup(options, replace(road(options), seed=seed))
        for lidar, limit in DEFAULTS.items():
            for estimator in (GICP, RKO, KISS, LIDAR_INERTIAL):
                result, _ = run_estimator(
                    *(options, on_lidar(estimator, lidar), recording),
                    experiment="outdoor_defaults",
                    case=lidar,
                    limit_over_100_m=limit,
                )
                results.append(result)
    return results


def patterns(options: ExperimentOptions) -> Sequence[Evaluation]:
    """Run odometry by LiDAR alone, and by LiDAR and IMU, with LiDARs of several patterns."""
    results = []
    for place, setup in {"room": room(options), "road": road(options)}.items():
        for seed in options.seeds:
            recording = record_setup(options, replace(setup, seed=seed))
            for lidar, limits_m in LIMITS_M[place].items():
                for estimator, limit_m in zip((KISS, LIDAR_INERTIAL), limits_m, strict=True):
                    result, _ = run_estimator(
                        *(options, on_lidar(estimator, lidar), recording),
                        experiment="patterns",
                        case=f"{lidar}, {place}",
                        limit_m=limit_m,
                    )
                    results.append(result)
    return results


def road(options: ExperimentOptions) -> Setup:
    """Return the tank's drive on its road, with LiDARs on the mast."""
    others = {"camera": None, "gnss": None, "lidar": None}
    sensors = others | on_mount(ROAD, "mast")
    return outdoors.drive(options, "road_lidars", outdoors.SECONDS, sensors)


def room(options: ExperimentOptions) -> Setup:
    """Return the robot's lap in the room, with LiDARs on top."""
    others = {"camera": None, "scanner": None}
    sensors = others | on_mount(ROOM, indoors.ON_TOP)
    return indoors.drive(options, "room_lidars", sensors, {"route": indoors.lap()}, ROOM_SECONDS)


def on_mount(lidars: Sequence[str], mount: Any) -> dict[str, Any]:
    """Return the sensors of a vehicle: LiDARs that don't see each other, on one mount."""
    return {
        SHEETS[lidar]: {
            "kind": "lidar",
            "datasheet": f"sensors/{SHEETS[lidar]}.yaml",
            "topic": f"/points/{SHEETS[lidar]}",
            "frame": f"{SHEETS[lidar]}_link",
            "mount": mount,
        }
        for lidar in lidars
    }


def on_lidar(estimator: Estimator, lidar: str) -> Estimator:
    """Return an estimator on the clouds of one of the LiDARs."""
    return estimator.with_lidar(f"/points/{SHEETS[lidar]}", f"{SHEETS[lidar]}_link")
