# SPDX-License-Identifier: Apache-2.0
"""What drivers read of a bag is what was written to it."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from groundlink.core.frames import matrix_from_quaternion, quaternion_from_rpy
from groundlink.messages.base import POINT, PointCloud
from groundlink.messages.navigation import Transform, Transforms
from groundlink.recording.ros_channels import RosFile
from groundlink.ros.cdr import CODECS, to_cdr

from .scripts import script

POINTS = np.array([(1, 2, 3, 4, 5, 0.01), (6, 7, 8, 9, 10, 0.02)], POINT)
CLOUD = PointCloud(1_500_000_000, "lidar_link", memoryview(POINTS.tobytes()))
MOUNTS = Transforms(
    (
        Transform(
            0, "base_link", "imu_link", (1.0, 0.0, 0.0), quaternion_from_rpy(0, 0, np.pi / 2)
        ),
        Transform(0, "base_link", "lidar_link", (1.0, 2.0, 0.5), quaternion_from_rpy(0, 0, np.pi)),
        Transform(0, "mast", "camera", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)),
    )
)


@pytest.fixture(scope="module")
def reading() -> Any:
    return script("ros_reading")


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    file = RosFile(tmp_path / "run.mcap")
    for topic, message in (("/tf_static", MOUNTS), ("/points", CLOUD)):
        file.topic(topic, CODECS[type(message)].ros_type).write(0, to_cdr(message))
    file.commit({})
    file.close()
    return tmp_path / "run.mcap"


def test_clouds(reading: Any, bag: Path) -> None:
    (cloud,) = reading.clouds(bag, "/points")
    assert cloud.stamp_s == 1.5
    assert cloud.points_m == pytest.approx(np.array([[1, 2, 3], [6, 7, 8]]))
    assert cloud.times_s == pytest.approx([0.01, 0.02])


def test_a_topic_that_is_not_there(reading: Any, bag: Path) -> None:
    with pytest.raises(SystemExit, match="no topic /cloud"):
        next(reading.clouds(bag, "/cloud"))


def test_where_a_frame_is_on_another(reading: Any, bag: Path) -> None:
    rotation, translation = reading.mount(bag, of="lidar_link", on="imu_link")
    assert translation == pytest.approx([2.0, 0.0, 0.5])
    assert rotation @ [1, 0, 0] == pytest.approx([0, 1, 0])


@pytest.mark.parametrize(
    ("frame", "words"), [("wheel", "no transform of frame wheel"), ("camera", "fixed to mast")]
)
def test_mounts_that_do_not_meet(reading: Any, bag: Path, frame: str, words: str) -> None:
    with pytest.raises(SystemExit, match=words):
        reading.mount(bag, of=frame, on="imu_link")


def test_trajectories_are_written_as_they_are(reading: Any, tmp_path: Path) -> None:
    generator = np.random.default_rng(1)
    turns = generator.normal(size=(50, 4))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    # A half turn about each axis is where formulas with a division fail.
    turns[:3] = np.eye(4)[:3]
    turns[turns[:, 3] < 0] *= -1
    poses = np.tile(np.eye(4), (50, 1, 1))
    poses[:, :3, :3] = matrix_from_quaternion(turns)
    poses[:, :3, 3] = generator.normal(size=(50, 3))
    file = tmp_path / "way.tum"
    reading.write_tum(file, np.arange(50) / 10, poses)
    told = np.loadtxt(file)
    assert told[:, 0] == pytest.approx(np.arange(50) / 10)
    assert told[:, 1:4] == pytest.approx(poses[:, :3, 3], abs=1e-8)
    assert np.abs(np.sum(told[:, 4:] * turns, axis=1)) == pytest.approx(1.0)
