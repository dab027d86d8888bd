# SPDX-License-Identifier: Apache-2.0
"""Section 6.3 of the paper with cameras: ORB-SLAM3 on a monocular and on an RGB-D camera.

Room and robot of `indoors`, on a route with half circles instead of turns on the spot.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from experiments.estimation.evaluation import Evaluation
from experiments.estimation.vocabulary import OUTDOORS
from experiments.experiment import ExperimentOptions
from experiments.recording.setups import Setup

from .indoors import drive
from .pictures import CameraStudy, orb_slam3

SECONDS = 70.0
"""A lap takes 52 s."""

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
        "horizontal_fov_deg": 73.0,
        "rate_hz": 15.0,
        "color": {"topic": "/camera/color/image_raw"},
    },
}
"""The depth camera of many robots, with its errors; its color has the same pixels. At this size it
gives the middle of its picture, whose pixels are square: 73 of its 87 degrees."""


def _oval() -> dict[str, Any]:
    """Return a route along the lanes with half circles at its ends."""
    east, west = ((3.8, 0.3, -90.0), (-3.8, 0.3, 90.0))
    points = [
        {
            "x_m": round(x + BEND_M * math.cos(math.radians(start + turn)), 3),
            "y_m": round(y + BEND_M * math.sin(math.radians(start + turn)), 3),
            **({"speed_mps": BEND_MPS} if turn else {}),
        }
        for x, y, start in (east, west)
        for turn in range(0, 181, 15)
    ]
    return {"kind": "waypoints", "speed_mps": 0.5, "closed": True, "laps": 3, "points": points}


BEND_M, BEND_MPS = 1.0, 0.3
ROUNDED: dict[str, Any] = {
    "placement": {"x_m": -3.8, "y_m": -0.7, "yaw_deg": 0.0},
    "route": _oval(),
}
"""The shipped route turns on the spot at its corners. One camera sees new things there and cannot
know how far they are, so cameras drive along half circles instead, and slowly: what comes into the
picture has to be seen from two places before the next comes."""

FEATURES = ("--features", "2000", "--contrast", "12")
"""Walls of plaster have little contrast; with 1200 features and 20 tracking ends before them."""

FIRST_FRAME_S = 2.0
"""When the robot moves."""

LIMIT_M = 0.05


def mono(options: ExperimentOptions) -> Sequence[Evaluation]:
    """Run ORB-SLAM3 on one camera at 30 Hz, given in real time (6.3)."""
    setup = drive(options, "indoor_mono", MONO, ROUNDED, SECONDS)
    return orb_slam3(options, _pictures(setup, *FEATURES))


def rgbd(options: ExperimentOptions) -> Sequence[Evaluation]:
    """Run ORB-SLAM3 on a depth camera (6.3)."""
    topics = {
        "--image": "/camera/color/image_raw/compressed",
        "--info": "/camera/color/camera_info",
        "--depth": "/camera/depth/image_rect_raw",
    }
    words = [word for pair in topics.items() for word in pair]
    setup = drive(options, "indoor_rgbd", RGBD, ROUNDED, SECONDS)
    return orb_slam3(options, replace(_pictures(setup, *FEATURES, *words), has_depth=True))


def _pictures(setup: Setup, *words: str) -> CameraStudy:
    return CameraStudy(
        setup=setup,
        scenes=OUTDOORS,
        from_s=FIRST_FRAME_S,
        limit_m=lambda _: LIMIT_M,
        words=words,
    )
