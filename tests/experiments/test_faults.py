# SPDX-License-Identifier: Apache-2.0
"""Each fault changes what it says, and nothing else."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import SeekingReader

from experiments.recording.faults import FAULTS, apply_fault, with_fault
from groundlink.core.frames import quaternion_from_rpy
from groundlink.messages.base import POINT, Imu, PointCloud
from groundlink.messages.navigation import Transform, Transforms
from groundlink.recording.ros_channels import RosFile
from groundlink.ros.cdr import CODECS, to_cdr
from groundlink.ros.types import STORE

TILT = quaternion_from_rpy(0.1, 0.0, 0.0)
IMU = Imu(10**9, "imu_link", TILT, (0.1, 0.2, 0.3), (0.0, 0.979, 9.7577), 0.0, 0.0, 0.0)
POINTS = np.array([(1, 2, 3, 4, 5, 0.01), (6, 7, 8, 9, 10, 0.02)], POINT)
CLOUD = PointCloud(2 * 10**9, "lidar_link", memoryview(POINTS.tobytes()))
MOUNTS = Transforms(
    tuple(
        Transform(0, "base_link", name, (0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0))
        for name in ("lidar_link", "imu_link")
    )
)


def _with(name: str, message: Any) -> Any:
    fault = FAULTS[name]
    assert CODECS[type(message)].ros_type == fault.ros_type
    return STORE.deserialize_cdr(apply_fault(bytes(to_cdr(message)), fault), fault.ros_type)


def _points(cloud: Any) -> Any:
    return np.frombuffer(cloud.data, POINT)


def test_the_gyroscope_turns_the_other_way() -> None:
    rates = _with("gyro_sign", IMU).angular_velocity
    assert (rates.x, rates.y, rates.z) == (-0.1, -0.2, -0.3)


def test_gravity_is_taken_away_whatever_the_tilt() -> None:
    force = _with("no_gravity", IMU).linear_acceleration
    assert (force.x, force.y, force.z) == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)


@pytest.mark.parametrize(
    ("name", "changed"),
    [
        ("mirrored_scan", {"y": [-2, -7]}),
        ("long_ranges", {"x": [1.1, 6.6], "y": [2.2, 7.7], "z": [3.3, 8.8]}),
        ("no_times", {"time": [0, 0]}),
        ("late_stamps", {}),
    ],
)
def test_points(name: str, changed: dict[str, list[float]]) -> None:
    cloud = _with(name, CLOUD)
    points = _points(cloud)
    for field in POINT.names or ():
        assert points[field] == pytest.approx(changed.get(field, POINTS[field]), rel=1e-6)
    late = 50_000_000 if name == "late_stamps" else 0
    assert (cloud.header.stamp.sec, cloud.header.stamp.nanosec) == (2, late)


def test_only_the_lidars_mount_is_tilted() -> None:
    lidar, imu = _with("wrong_mount", MOUNTS).transforms
    assert lidar.transform.rotation.y == pytest.approx(np.sin(np.radians(2.5)))
    assert imu.transform.rotation.y == 0.0


def test_the_rest_of_a_bag_goes_over_byte_for_byte(tmp_path: Path) -> None:
    bag, out = tmp_path / "run.mcap", tmp_path / "faulty.mcap"
    file = RosFile(bag)
    told = (("/points", CLOUD), ("/imu", IMU), ("/tf", MOUNTS), ("/tf_static", MOUNTS))
    for nanos, (topic, message) in enumerate(told):
        ros_type = CODECS[type(message)].ros_type
        file.topic(topic, ros_type).write(nanos, to_cdr(message))
    file.commit({})
    file.close()
    assert with_fault(bag, out, FAULTS["wrong_mount"]) == 1
    with bag.open("rb") as first, out.open("rb") as second:
        pairs = zip(
            SeekingReader(first).iter_messages(), SeekingReader(second).iter_messages(), strict=True
        )
        for (_, channel, original), (_, other, copied) in pairs:
            assert (channel.topic, original.log_time) == (other.topic, copied.log_time)
            assert (original.data == copied.data) == (channel.topic != "/tf_static")
