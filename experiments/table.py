# SPDX-License-Identifier: Apache-2.0
"""Table of experiments for `python -m experiments`."""

from .experiment import Experiment
from .studies import guard, indoor_cameras, indoors, live, loss, outdoors, track, transfer

EXPERIMENTS: dict[str, Experiment] = {
    "transfer": Experiment(
        what="6.1: what a message takes to ROS, by its size and the way",
        run=transfer.transfer,
        minutes=3,
    ),
    "indoor_scans": Experiment(
        what="6.3: 2D graph SLAM with loop closure on scans and odometry",
        run=indoors.scans,
        minutes=3,
    ),
    "indoor_lidar": Experiment(
        what="6.3: LiDAR and IMU, and LiDAR alone, on 16 rings",
        run=indoors.clouds,
        minutes=5,
    ),
    "live": Experiment(
        what="2D graph SLAM as a ROS node, in real time; its poses and map come back to the bus",
        run=live.slam,
        minutes=8,
    ),
    "indoor_mono": Experiment(
        what="6.3: ORB-SLAM3 on one camera at 30 Hz",
        run=indoor_cameras.mono,
        minutes=8,
    ),
    "indoor_rgbd": Experiment(
        what="6.3: ORB-SLAM3 on a depth camera",
        run=indoor_cameras.rgbd,
        minutes=8,
    ),
    "outdoor_lidar": Experiment(
        what="6.4: LiDAR and IMU, and LiDAR alone, over 170 m of the road",
        run=outdoors.lidar,
        minutes=6,
    ),
    "outdoor_lap": Experiment(
        what="6.4: the same over a closed lap of 370 m",
        run=outdoors.lap,
        minutes=9,
    ),
    "outdoor_mono": Experiment(
        what="6.4: ORB-SLAM3 on one camera at 30 Hz, over 170 m",
        run=outdoors.mono,
        minutes=11,
    ),
    "track": Experiment(
        what="6.2: sums of squared distances at checkpoints, for two LiDARs",
        run=track.checkpoints,
        minutes=6,
    ),
    "shutter": Experiment(
        what="6.2: sweeps and instantaneous pictures of a fast drive",
        run=track.shutter,
        minutes=6,
    ),
    "loss": Experiment(
        what="the whole chain over links that lose datagrams",
        run=loss.loss,
        minutes=10,
    ),
    "guard": Experiment(
        what="faults that are put into data on purpose have to be found",
        run=guard.guard,
        minutes=5,
    ),
}

SHORT = ("indoor_scans",)
"""What a short run consists of."""
