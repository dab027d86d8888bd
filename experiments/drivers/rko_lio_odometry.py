# SPDX-License-Identifier: Apache-2.0
"""RKO-LIO (LiDAR and IMU) on a bag: writes the trajectory of the LiDAR frame.

Settings are the program's defaults, except the number of threads: one, so that the result is
deterministic. The mount of the IMU is that of /tf_static. A pose holds at the end of a sweep.

The program's own loader is not used. It opens folders with a `metadata.yaml` only, and detects by
their distance from the stamp whether times of points are absolute: in the second sweep of a bag
that begins at 0 it takes those of the first one for absolute.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from rko_lio.config import LIOConfig, PipelineConfig
from rko_lio.dataloaders.sequencer import LidarIMUSequencer
from rko_lio.lio_pipeline import LIOPipeline
from ros_reading import cloud_of, mount
from rosbags.highlevel import AnyReader

NANOS = 1e9


def main() -> None:
    """Run it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("bag", type=Path)
    parser.add_argument("out", type=Path, help="trajectory, TUM format")
    parser.add_argument("--lidar-topic", default="/points")
    parser.add_argument("--imu-topic", default="/imu")
    parser.add_argument("--lidar-frame", default="lidar_link")
    parser.add_argument("--imu-frame", default="imu_link")
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    pipeline = LIOPipeline(PipelineConfig(lio=LIOConfig(max_num_threads=options.threads)))
    rotation, translation = mount(options.bag, of=options.imu_frame, on=options.lidar_frame)
    pipeline.extrinsic_imu2base = np.eye(4)
    pipeline.extrinsic_imu2base[:3] = np.column_stack([rotation, translation])
    found = readings(options.bag, options.imu_topic, options.lidar_topic)
    for kind, reading in LidarIMUSequencer(found):
        if kind == "imu":
            pipeline.add_imu(**reading)
        else:
            pipeline.register_scan(**reading)
    stamps, poses = pipeline.lio.poses_with_timestamps()
    lines = [
        f"{stamp / NANOS:.9f} " + " ".join(f"{number:.9f}" for number in pose)
        for stamp, pose in zip(stamps, poses, strict=True)
    ]
    options.out.write_text("\n".join(lines) + "\n")
    print(f"{len(lines)} sweeps")


def readings(bag: Path, imu_topic: str, lidar_topic: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the readings of IMU and LiDAR as arguments of the program's pipeline."""
    with AnyReader([bag]) as reader:
        connections = [c for c in reader.connections if c.topic in (imu_topic, lidar_topic)]
        for connection, _, raw in reader.messages(connections):
            message: Any = reader.deserialize(raw, connection.msgtype)
            if connection.topic == imu_topic:
                force, rate = message.linear_acceleration, message.angular_velocity
                yield (
                    "imu",
                    {
                        "time": nanos(message.header.stamp),
                        "acceleration": np.array([force.x, force.y, force.z]),
                        "angular_velocity": np.array([rate.x, rate.y, rate.z]),
                    },
                )
            else:
                cloud = cloud_of(message, f"{bag}: {lidar_topic}")
                instants = nanos(message.header.stamp) + (NANOS * cloud.times_s).astype(np.int64)
                yield (
                    "lidar",
                    {
                        "start_time_ns": int(instants.min()),
                        "end_time_ns": int(instants.max()),
                        "scan": cloud.points_m,
                        "timestamps": instants,
                    },
                )


def nanos(stamp: Any) -> int:
    """Return a builtin_interfaces/Time as nanoseconds."""
    return int(stamp.sec) * int(NANOS) + int(stamp.nanosec)


if __name__ == "__main__":
    main()
