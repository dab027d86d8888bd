# SPDX-License-Identifier: Apache-2.0
"""KISS-ICP (LiDAR alone) on a bag: writes the trajectory of the LiDAR frame.

Settings are the program's defaults. It deskews a sweep by the last motion, so a pose holds at the
end of a sweep; that instant is written. The loader is `rosbag`: the one named `mcap` fails with the
current mcap-ros2-support.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from kiss_icp.config import load_config
from kiss_icp.datasets.rosbag import RosbagDataset
from kiss_icp.kiss_icp import KissICP
from ros_reading import SWEEPS_HELP, clouds, write_tum

AT = {"corrected": 1.0, "as-they-are": 0.5, "instantaneous": 0.0}
"""Where in a sweep a pose holds, from its first point to its last."""


def main() -> None:
    """Run it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("bag", type=Path)
    parser.add_argument("out", type=Path, help="trajectory, TUM format")
    parser.add_argument("--lidar-topic", default="/points")
    parser.add_argument("--voxel-m", type=float, help="of the map; the program's own is 1")
    parser.add_argument("--sweeps", choices=AT, default="corrected", help=SWEEPS_HELP)
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    config = load_config(None)
    config.data.min_range = 0.5
    config.data.deskew = options.sweeps == "corrected"
    config.registration.max_num_threads = options.threads
    if options.voxel_m:
        config.mapping.voxel_size = options.voxel_m
    odometry = KissICP(config=config)
    dataset = RosbagDataset(options.bag, options.lidar_topic)
    poses = []
    for index in range(len(dataset)):
        odometry.register_frame(*dataset[index])
        poses.append(odometry.last_pose)
    instants = [
        cloud.stamp_s + AT[options.sweeps] * cloud.times_s.max(initial=0.0)
        for cloud in clouds(options.bag, options.lidar_topic)
    ]
    write_tum(options.out, instants, poses)
    print(f"{len(poses)} sweeps")


if __name__ == "__main__":
    main()
