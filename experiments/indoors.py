# SPDX-License-Identifier: Apache-2.0
"""Section 6.3 of the paper: a decontamination robot in a room, by laser scans and by clouds.

Rule: `indoor_paper` as it is shipped, for a lap and some metres of the next. Each run has the
sensors that its program takes; the drive is the same.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml

from . import environments, figures
from .evaluation import Result
from .experiment import Options, judged, recorded
from .odometries import GICP, LIDAR_INERTIAL, ran
from .programs import YAG_SLAM
from .setups import SCENARIOS, Setup, waypoints

SECONDS = 75.0
"""A lap takes 55 s."""

SHORT_S = 12.0

SCANS: dict[str, Any] = {
    "camera": None,
    "imu": {"rate_hz": 100.0},
    "odometry": {"wheel_radius_m": 0.101, "track_multiplier": 1.02},
}
"""Odometry believes in wheels that are 1 % too large and 2 % too far apart, as when measured
by hand does. The IMU goes along; yag-slam does not take it."""

CLOUDS: dict[str, Any] = {
    "scanner": None,
    "camera": None,
    "lidar": {
        "kind": "lidar",
        "datasheet": "sensors/vlp16.yaml",
        "topic": "/points",
        "frame": "lidar_link",
        "mount": {"xyz_m": [0.3, 0.0, 1.7]},
    },
}
"""A VLP-16 on top, ahead of the column."""

CRAWL_M = 0.1
"""2 s."""


def scans(options: Options) -> Sequence[Result]:
    """Run 2D graph SLAM with loop closure on scans and odometry; odometry alone to compare."""
    results = []
    for seed in options.seeds:
        recording = recorded(options, drive(options, "indoor_scans", SECONDS, SCANS, {}, seed))
        folder = options.folder("runs", recording.folder.name)
        ways = []
        for case, more in {"": [], "odometry alone": ["--odometry-alone"]}.items():
            tum = folder / ("odometry.tum" if more else "yag_slam.tum")
            began_s = time.monotonic()
            environments.run(
                YAG_SLAM,
                [recording.bag, tum, *more],
                options.out,
                options.say,
                label=f"indoor_scans, seed {seed}",
                log=tum.with_suffix(".log"),
            )
            result, way = judged(
                *(options, recording, tum),
                frame="scan_link",
                seed=seed,
                experiment="indoor_scans",
                program=YAG_SLAM.name,
                case=case,
                took_s=time.monotonic() - began_s,
                limit_m=0.0 if more else 0.02,
            )
            results.append(result)
            ways.append(replace(way, label=case) if case else way)
        if seed == options.seeds[0]:
            figures.trajectories(_figure(options, "indoor_scans"), recording.scenario, ways)
            figures.map_beside_plan(
                _figure(options, "indoor_scans_map"),
                recording.scenario,
                folder / "yag_slam.yaml",
                ways[0],
            )
    return results


def clouds(options: Options) -> Sequence[Result]:
    """Run LiDAR and IMU, and LiDAR alone, on a LiDAR of 16 rings; once round and a bit more."""
    document = yaml.safe_load((SCENARIOS / "indoor_paper.yaml").read_text(encoding="utf-8"))
    vehicle = document["vehicles"][0]
    points, speed_mps = vehicle["route"]["points"], vehicle["route"]["speed_mps"]
    lap = waypoints(vehicle["placement"], [*points, *points[:3]], speed_mps, CRAWL_M)
    results = []
    for seed in options.seeds:
        setup = drive(options, "indoor_lidar", SECONDS, CLOUDS, {"route": lap}, seed)
        recording = recorded(options, setup)
        ran_by = [
            ran(options, odometry, recording, experiment="indoor_lidar", seed=seed)
            for odometry in (LIDAR_INERTIAL, GICP)
        ]
        results += [result for result, _ in ran_by]
        if seed == options.seeds[0]:
            ways = [way for _, way in ran_by]
            figures.trajectories(_figure(options, "indoor_lidar"), recording.scenario, ways)
    return results


def drive(
    options: Options,
    name: str,
    seconds: float,
    sensors: dict[str, Any],
    vehicle: dict[str, Any],
    seed: int = 1,
) -> Setup:
    """Return the robot's drive."""
    return Setup(
        name=f"{name}_short" if options.short else name,
        scenario="indoor_paper",
        seconds=SHORT_S if options.short else seconds,
        seed=seed,
        sensors=sensors,
        vehicle=vehicle,
    )


def _figure(options: Options, name: str) -> Path:
    return options.folder(options.figures) / f"{name}.png"
