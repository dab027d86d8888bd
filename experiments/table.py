# SPDX-License-Identifier: Apache-2.0
"""The table of experiments: what `python -m experiments` can run.

Rule: one row each; an experiment is a function of its own module.
"""

from __future__ import annotations

from . import indoors, live
from .experiment import Experiment

EXPERIMENTS: dict[str, Experiment] = {
    "indoor_scans": Experiment(
        what="6.3: 2D graph SLAM with loop closure on scans and odometry",
        run=indoors.scans,
        minutes=8,
    ),
    "live": Experiment(
        what="2D graph SLAM as a ROS node, in real time; its poses and map come back to the bus",
        run=live.slam,
        minutes=4,
    ),
    "indoor_mono": Experiment(
        what="6.3: ORB-SLAM3 on one camera at 30 Hz",
        run=indoors.mono,
        minutes=12,
    ),
    "indoor_rgbd": Experiment(
        what="6.3: ORB-SLAM3 on a depth camera",
        run=indoors.rgbd,
        minutes=12,
    ),
}

SHORT = ("indoor_scans",)
"""What a short run consists of."""
