# SPDX-License-Identifier: Apache-2.0
"""Section 6.4 of the paper: a tank on a road through a hamlet, by LiDAR and IMU, and by a camera.

Rule: `outdoor_paper` as it is shipped, for a part of its way or for a lap. What an experiment
changes of it stands in its setup.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import yaml

from .evaluation import Result
from .experiment import Options, recorded
from .figures import trajectories
from .odometries import GICP, LIDAR_INERTIAL, ran
from .pictures import Pictures, orb_slam3
from .setups import SCENARIOS, Setup, waypoints
from .vocabulary import INDOORS

SECONDS = 75.0
"""170 m."""

LAP_SECONDS = 156.0
"""370 m, and back where it began."""

SHORT_SECONDS = 12.0

OPEN_COUNTRY = (
    "hybrid_metric.enable=0",
    "adaptive_voxelization.enable=0",
    "mapping.planar_threshold=0.01",
)
"""What genz-lio is told beside its settings for a Velodyne. From a road a LiDAR sees mostly ground,
in rings that go with the vehicle: points matched to points of the map say that it stands, and
thinning for a room leaves too little of houses and trees. The threshold is that of the program's
own settings for a VLP-16 in the field."""

LIMIT_M = 0.4
CAMERA_LIMIT_SHARE = 0.01
"""Of the way."""

CRAWL_M = 0.3
"""On which the tank is for 3 to 4 s; it slides a hand's breadth while it comes to rest."""

FIRST_FRAME_S = 6.0
"""When the tank has begun to move."""


def road(speed_mps: float | None = None) -> dict[str, Any]:
    """Return the way of the shipped scenario, begun at a crawl, at its own speed or another."""
    document = yaml.safe_load((SCENARIOS / "outdoor_paper.yaml").read_text(encoding="utf-8"))
    vehicle = document["vehicles"][0]
    route = vehicle["route"]
    speed_mps = speed_mps or route["speed_mps"]
    return waypoints(vehicle["placement"], route["points"], speed_mps, CRAWL_M)


def _lidar(options: Options, name: str, seconds: float) -> list[Result]:
    results = []
    for seed in options.seeds:
        setup = Setup(
            name=name,
            scenario="outdoor_paper",
            seconds=SHORT_SECONDS if options.short else seconds,
            seed=seed,
            sensors={"camera": None, "gnss": None},
            vehicle={"route": road()},
        )
        recording = recorded(options, setup)
        ways = []
        for odometry in (LIDAR_INERTIAL, GICP):
            inertial = odometry is LIDAR_INERTIAL
            result, way = ran(
                options,
                odometry,
                recording,
                experiment=name,
                seed=seed,
                more=[f"--set={change}" for change in OPEN_COUNTRY] if inertial else (),
                limit_m=LIMIT_M if inertial else 0.0,
            )
            results.append(result)
            ways.append(way)
        if seed == options.seeds[0]:
            figure = options.folder(options.figures) / f"{name}.png"
            trajectories(figure, recording.scenario, ways)
    return results


def lidar(options: Options) -> Sequence[Result]:
    """Run LiDAR and IMU, and LiDAR alone, over 170 m."""
    return _lidar(options, "outdoor_lidar", SECONDS)


def lap(options: Options) -> Sequence[Result]:
    """Run them over a whole lap: how far the end is from the start."""
    return _lidar(options, "outdoor_lap", LAP_SECONDS)


def mono(options: Options) -> Sequence[Result]:
    """Run ORB-SLAM3 on one camera at 30 Hz, given in real time, over 170 m."""
    setup = Setup(
        name="outdoor_mono",
        scenario="outdoor_paper",
        seconds=SHORT_SECONDS if options.short else SECONDS,
        sensors={"lidar": None, "gnss": None, "camera": {"rate_hz": 30.0}},
        vehicle={"route": road()},
    )
    pictures = Pictures(
        setup=setup,
        scenes=INDOORS,
        from_s=FIRST_FRAME_S,
        limit_m=lambda recording: CAMERA_LIMIT_SHARE * recording.truth().length_m,
    )
    return orb_slam3(options, "outdoor_mono", pictures)
