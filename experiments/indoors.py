# SPDX-License-Identifier: Apache-2.0
"""Section 6.3 of the paper: a decontamination robot in a room, by laser scans and by cameras.

Rule: `indoor_paper` as it is shipped, for a lap and some metres of the next. Each run has the
sensors that its program takes; the drive is the same.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from . import environments, figures
from .evaluation import Result
from .experiment import Options, judged, recorded
from .pictures import Pictures, orb_slam3
from .programs import YAG_SLAM
from .setups import Setup
from .vocabulary import OUTDOORS

SCANS_S, PICTURES_S = 75.0, 60.0
"""A lap takes 55 s."""

SHORT_S = 12.0

SCANS: dict[str, Any] = {
    "camera": None,
    "imu": {"rate_hz": 100.0},
    "odometry": {"wheel_radius_m": 0.101, "track_multiplier": 1.02},
}
"""Odometry believes in wheels that are 1 % too large and 2 % too far apart, as when measured
by hand does. The IMU goes along; yag-slam does not take it."""

MONO: dict[str, Any] = {"scanner": None, "imu": None, "camera": {"rate_hz": 30.0}}
RGBD: dict[str, Any] = {
    "scanner": None,
    "imu": None,
    "camera": None,
    "depth": {
        "kind": "depth_camera",
        "datasheet": "sensors/realsense_d435i.yaml",
        "topic": "/camera/depth/image_rect_raw",
        "frame": "camera_optical_frame",
        "mount": "camera",
        "width": 640,
        "height": 480,
        "rate_hz": 15.0,
        "color": {"topic": "/camera/color/image_raw"},
    },
}
"""The depth camera of many robots, with its errors; its colour has the same pixels."""


def _oval() -> dict[str, Any]:
    """Return a route along the lanes with half circles at its ends."""
    east, west = ((3.8, 0.3, -90.0), (-3.8, 0.3, 90.0))
    points = [
        {
            "x_m": round(x + BEND_M * math.cos(math.radians(start + turn)), 3),
            "y_m": round(y + BEND_M * math.sin(math.radians(start + turn)), 3),
        }
        for x, y, start in (east, west)
        for turn in range(0, 181, 15)
    ]
    return {"kind": "waypoints", "speed_mps": 0.5, "closed": True, "laps": 3, "points": points}


BEND_M = 1.0
ROUNDED: dict[str, Any] = {
    "placement": {"x_m": -3.8, "y_m": -0.7, "yaw_deg": 0.0},
    "route": _oval(),
}
"""The shipped route turns on the spot at its corners. One camera sees new things there and cannot
know how far they are, so cameras drive along half circles instead."""

FEATURES = ("--features", "2000", "--contrast", "12")
"""Walls of plaster have little contrast; with 1200 features and 20 tracking ends before them."""

FIRST_FRAME_S = 2.0
"""When the robot moves."""

PICTURES_LIMIT_M = 0.05


def scans(options: Options) -> Sequence[Result]:
    """Run 2D graph SLAM with loop closure on scans and odometry; odometry alone to compare."""
    results = []
    for seed in options.seeds:
        recording = recorded(options, _drive(options, "indoor_scans", SCANS_S, SCANS, {}, seed))
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
                _figure(options, "indoor_map"),
                recording.scenario,
                folder / "yag_slam.yaml",
                ways[0],
            )
    return results


def mono(options: Options) -> Sequence[Result]:
    """Run ORB-SLAM3 on one camera at 30 Hz, given in real time."""
    setup = _drive(options, "indoor_mono", PICTURES_S, MONO, ROUNDED)
    return orb_slam3(options, "indoor_mono", _pictures(setup, *FEATURES))


def rgbd(options: Options) -> Sequence[Result]:
    """Run ORB-SLAM3 on a depth camera."""
    topics = {
        "--image": "/camera/color/image_raw/compressed",
        "--info": "/camera/color/camera_info",
        "--depth": "/camera/depth/image_rect_raw",
    }
    words = [word for pair in topics.items() for word in pair]
    setup = _drive(options, "indoor_rgbd", PICTURES_S, RGBD, ROUNDED)
    # Patterns of surfaces repeat to the pixel, so that it closes loops that are none.
    pictures = _pictures(setup, *FEATURES, *words, "--no-loops")
    return orb_slam3(options, "indoor_rgbd", replace(pictures, has_depth=True))


def _pictures(setup: Setup, *words: str) -> Pictures:
    return Pictures(
        setup=setup,
        scenes=OUTDOORS,
        from_s=FIRST_FRAME_S,
        limit_m=lambda _: PICTURES_LIMIT_M,
        words=words,
    )


def _drive(
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
