# SPDX-License-Identifier: Apache-2.0
"""small_gicp (LiDAR alone) on a bag: writes the trajectory of the LiDAR frame.

Odometry as in the library's example: each sweep is registered to a Gaussian voxel map (VGICP) from
the pose predicted by the last motion, then added to the map. A sweep is deskewed to its middle,
where its pose holds: deskewed to its stamp, an error of the last motion would alternate undamped.
One thread, so that the result is deterministic.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import small_gicp
from ros_reading import SWEEPS_HELP, Cloud, Floats, clouds, write_tum

AT = {"corrected": 0.5, "as-they-are": 0.5, "instantaneous": 0.0}
"""Where in a sweep a pose holds, from its first point to its last."""


def main() -> None:
    """Run it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("bag", type=Path)
    parser.add_argument("out", type=Path, help="trajectory, TUM format")
    parser.add_argument("--lidar-topic", default="/points")
    parser.add_argument("--voxel-m", type=float, default=1.0, help="of the map")
    parser.add_argument("--thinned-m", type=float, default=0.25, help="voxels of a sweep")
    parser.add_argument("--sweeps", choices=AT, default="corrected", help=SWEEPS_HELP)
    options = parser.parse_args()
    voxels = small_gicp.GaussianVoxelMap(options.voxel_m)
    voxels.set_lru(horizon=100000)
    stamps: list[float] = []
    instants: list[float] = []
    poses: list[Floats] = []
    twist = np.zeros(6)
    for cloud in clouds(options.bag, options.lidar_topic):
        step_s = cloud.stamp_s - stamps[-1] if stamps else 0.0
        after_s = AT[options.sweeps] * cloud.times_s.max(initial=0.0)
        if options.sweeps == "corrected":
            points = corrected(cloud, twist, after_s)
        else:
            points = cloud.points_m
        sweep, _ = small_gicp.preprocess_points(
            points, downsampling_resolution=options.thinned_m, num_neighbors=10, num_threads=1
        )
        pose = np.eye(4)
        if poses:
            found = small_gicp.align(
                voxels,
                sweep,
                init_T_target_source=poses[-1] @ motion(twist * step_s),
                max_correspondence_distance=2.0,
                num_threads=1,
                max_iterations=30,
            )
            pose = found.T_target_source
            twist = logarithm(np.linalg.inv(poses[-1]) @ pose) / step_s
        voxels.insert(sweep, pose)
        stamps.append(cloud.stamp_s)
        instants.append(cloud.stamp_s + after_s)
        poses.append(pose)
    write_tum(options.out, instants, poses)
    print(f"{len(poses)} sweeps")


def corrected(cloud: Cloud, twist: Floats, after_s: float) -> Floats:
    """Return a sweep's points as they would be from where its sensor is so long after the stamp.

    Parameters
    ----------
    twist
        shape (6,): the sensor's velocity, m/s, and its turn rate, rad/s, both in its own frame.
    """
    later_s = (cloud.times_s - after_s)[:, None]
    turns = later_s * twist[3:]
    angles = np.linalg.norm(turns, axis=1, keepdims=True)
    axes = turns / np.maximum(angles, 1e-12)
    points = cloud.points_m
    # Rodrigues' formula.
    along = axes * np.sum(axes * points, axis=1, keepdims=True)
    turned: Floats = (
        along + np.cos(angles) * (points - along) + np.sin(angles) * np.cross(axes, points)
    )
    return turned + later_s * twist[:3]


def motion(twist: Floats) -> Floats:
    """Return the pose, shape (4, 4), after a second of a constant twist; a chord for the arc."""
    pose = np.eye(4)
    pose[:3, :3] = _rotation(twist[3:])
    pose[:3, 3] = twist[:3]
    return pose


def logarithm(pose: Floats) -> Floats:
    """Return the twist whose `motion` this is."""
    r = pose[:3, :3]
    angle = np.arccos(np.clip((np.trace(r) - 1) / 2, -1.0, 1.0))
    axis = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]) / 2
    turn = axis if angle < 1e-9 else axis * angle / np.sin(angle)
    return np.concatenate([pose[:3, 3], turn])


def _rotation(turn: Floats) -> Floats:
    angle = float(np.linalg.norm(turn))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = turn / angle
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    rotation: Floats = np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k
    return rotation


if __name__ == "__main__":
    main()
