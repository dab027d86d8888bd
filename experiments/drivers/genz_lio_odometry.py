# SPDX-License-Identifier: Apache-2.0
"""GenZ-LIO (LiDAR and IMU) on a bag: writes the trajectory of the IMU frame.

Settings are the program's defaults for a Velodyne, except topics, the mount of the LiDAR on the IMU
(from /tf_static) and given options. The program assumes rest in the first sweep. A pose holds at
the end of a sweep.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from pathlib import Path

from genz_lio.config import load_config
from genz_lio.datasets import Frame
from genz_lio.datasets.rosbag import RosbagDataset
from genz_lio.packaged_configs import export_config
from genz_lio.pipeline import Pipeline
from ros_reading import mount, write_tum


class Later:
    """A dataset without what was before a time."""

    def __init__(self, dataset: RosbagDataset, from_s: float) -> None:
        self._dataset = dataset
        self._from_s = from_s
        self.sequence_id = dataset.sequence_id

    def __iter__(self) -> Iterator[Frame]:
        """Yield each sweep with what the IMU measured meanwhile."""
        return (frame for frame in self._dataset if frame.begin_time >= self._from_s)


def main() -> None:
    """Run it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("bag", type=Path)
    parser.add_argument("out", type=Path, help="trajectory, TUM format")
    parser.add_argument("--lidar-topic", default="/points")
    parser.add_argument("--imu-topic", default="/imu")
    parser.add_argument("--lidar-frame", default="lidar_link")
    parser.add_argument("--imu-frame", default="imu_link")
    parser.add_argument("--set", action="append", default=[], metavar="SECTION.FIELD=NUMBER")
    parser.add_argument("--from-s", type=float, default=0.0, help="stamp of the first sweep")
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        settings = Path(folder) / "velodyne.yaml"
        export_config("default/velodyne.yaml", settings)
        config = load_config(settings)
    config.max_threads = options.threads
    rotation, translation = mount(options.bag, of=options.lidar_frame, on=options.imu_frame)
    config.mapping.extrinsic_r, config.mapping.extrinsic_t = rotation, translation
    for change in options.set:
        name, _, number = change.partition("=")
        section, _, field = name.partition(".")
        target = getattr(config, section)
        setattr(target, field, type(getattr(target, field))(float(number)))
    dataset = RosbagDataset(
        options.bag,
        lidar_topic=options.lidar_topic,
        imu_topic=options.imu_topic,
        preprocess=config.preprocess,
    )
    pipeline = Pipeline(Later(dataset, options.from_s), config)
    summary = pipeline.run()
    write_tum(options.out, pipeline.timestamps, pipeline.poses)
    print(
        f"{summary.frames} sweeps, {summary.skipped} skipped, "
        f"{summary.mean_frame_time_ms:.0f} ms each, {summary.path_length:.1f} m"
    )


if __name__ == "__main__":
    main()
