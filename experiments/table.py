# SPDX-License-Identifier: Apache-2.0
"""Table of experiments for `python -m experiments`."""

from .experiment import Experiment
from .studies import (
    guard,
    indoor_cameras,
    indoors,
    live,
    live_odometry,
    loss,
    navigation,
    outdoors,
    patterns,
    track,
    transfer,
)

EXPERIMENTS: dict[str, Experiment] = {
    "transfer": Experiment(transfer.transfer, minutes=3),
    "indoor_scans": Experiment(indoors.scans, minutes=3),
    "indoor_lidar": Experiment(indoors.clouds, minutes=5),
    "live": Experiment(live.slam, minutes=8),
    "live_lidar": Experiment(live_odometry.lidar, minutes=5),
    "live_camera": Experiment(live_odometry.camera, minutes=5),
    "navigation": Experiment(navigation.tour, minutes=5),
    "indoor_mono": Experiment(indoor_cameras.mono, minutes=8),
    "indoor_rgbd": Experiment(indoor_cameras.rgbd, minutes=8),
    "outdoor_lidar": Experiment(outdoors.lidar, minutes=6),
    "outdoor_grass": Experiment(outdoors.grass, minutes=12),
    "outdoor_lap": Experiment(outdoors.lap, minutes=9),
    "outdoor_defaults": Experiment(patterns.defaults, minutes=15),
    "outdoor_mono": Experiment(outdoors.mono, minutes=11),
    "patterns": Experiment(patterns.patterns, minutes=16),
    "track": Experiment(track.checkpoints, minutes=6),
    "shutter": Experiment(track.shutter, minutes=6),
    "loss": Experiment(loss.loss, minutes=10),
    "guard": Experiment(guard.guard, minutes=5),
}

SHORT = ("indoor_scans",)
"""What a short run consists of."""
