# SPDX-License-Identifier: Apache-2.0
"""Section 6.4 of the paper: a tank on a road through a hamlet, by LiDAR and IMU, and by a camera.

Rule: `outdoor_paper` as it is shipped, for a part of its way or for a lap. What an experiment
changes of it stands in its setup.
"""

from __future__ import annotations

from collections.abc import Sequence

from groundlink.errors import UserError

from . import figures
from .evaluation import Result
from .experiment import Options, lost
from .odometries import GICP, KISS, LIDAR_INERTIAL, ran
from .recordings import Recording, record
from .setups import Setup

SECONDS = 75.0
"""170 m."""

LAP_SECONDS = 156.0
"""370 m, and back where it began."""

SHORT_SECONDS = 12.0

LIMIT_M = 0.4


def recorded(options: Options, setup: Setup) -> Recording:
    """Return a recording in which nothing is missing.

    Raises
    ------
    UserError
        when something is.
    """
    recording = record(setup, options.out, options.say)
    if words := lost(recording.accounts):
        raise UserError(f"{setup.name}, seed {setup.seed}: not all came to the bag: {words}")
    return recording


def _lidar(options: Options, name: str, seconds: float, seeds: Sequence[int]) -> list[Result]:
    results = []
    for seed in seeds:
        setup = Setup(
            name=name,
            scenario="outdoor_paper",
            seconds=SHORT_SECONDS if options.short else seconds,
            seed=seed,
            sensors={"camera": None, "gnss": None},
        )
        recording = recorded(options, setup)
        ways = []
        for odometry in (LIDAR_INERTIAL, KISS, GICP):
            limit_m = LIMIT_M if odometry is LIDAR_INERTIAL else 0.0
            result, way = ran(
                options, odometry, recording, experiment=name, seed=seed, limit_m=limit_m
            )
            results.append(result)
            ways.append(way)
        if seed == seeds[0]:
            figure = options.folder("figures") / f"{name}.png"
            figures.trajectories(figure, recording.scenario, ways)
    return results


def lidar(options: Options) -> Sequence[Result]:
    """Run LiDAR and IMU, and LiDAR alone, over 170 m."""
    return _lidar(options, "outdoor_lidar", SECONDS, options.seeds)


def lap(options: Options) -> Sequence[Result]:
    """Run them over a whole lap, once: how far the end is from the start."""
    return _lidar(options, "outdoor_lap", LAP_SECONDS, options.seeds[:1])
