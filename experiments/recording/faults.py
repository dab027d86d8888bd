# SPDX-License-Identifier: Apache-2.0
"""Deliberate faults in recorded data, applied to a copy of a bag.

A fault changes messages of one type by a pure function; all other bytes stay.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import SeekingReader
from numpy.typing import NDArray

from groundlink.core.frames import matrix_from_quaternion, multiply, quaternion_from_rpy
from groundlink.recording.ros_channels import RosFile
from groundlink.ros.streams import TF_STATIC_TOPIC
from groundlink.ros.types import STORE, nanos, quaternion, time, vector, xyz, xyzw

STANDARD_GRAVITY_MPS2 = 9.80665
STRETCH = 1.1
LATE_NANOS = 50_000_000
TILT_RAD = np.radians(5.0)

IMU, CLOUD, TF = "sensor_msgs/msg/Imu", "sensor_msgs/msg/PointCloud2", "tf2_msgs/msg/TFMessage"


@dataclass(frozen=True)
class BagFault:
    """A fault of recorded data."""

    ros_type: str
    """Of the messages that are changed."""

    spoil: Callable[[Any], None]
    """Changes a message in place."""

    words: str
    """Description."""

    topics: tuple[str, ...] = ()
    """Affected topics; empty for all of the type."""


def _gyro_sign(imu: Any) -> None:
    x, y, z = xyz(imu.angular_velocity)
    imu.angular_velocity = vector((-x, -y, -z))


def _no_gravity(imu: Any) -> None:
    """Remove gravity from the specific force, by the orientation."""
    up = matrix_from_quaternion(xyzw(imu.orientation))[2]
    force = np.array(xyz(imu.linear_acceleration)) - STANDARD_GRAVITY_MPS2 * up
    x, y, z = force.tolist()
    imu.linear_acceleration = vector((x, y, z))


def _mirrored(cloud: Any) -> None:
    points = _records(cloud)
    points["y"] = -points["y"]


def _stretched(cloud: Any) -> None:
    points = _records(cloud)
    for axis in "xyz":
        points[axis] *= STRETCH


def _no_times(cloud: Any) -> None:
    _records(cloud)["time"] = 0.0


def _late(cloud: Any) -> None:
    cloud.header.stamp = time(nanos(cloud.header.stamp) + LATE_NANOS)


def _tilted(mounts: Any) -> None:
    """Tilt the LiDAR downwards, in tf only."""
    for entry in mounts.transforms:
        if entry.child_frame_id == "lidar_link":
            turned = multiply(
                xyzw(entry.transform.rotation), quaternion_from_rpy(0.0, float(TILT_RAD), 0.0)
            )
            entry.transform.rotation = quaternion(tuple(turned.tolist()))


FAULTS: dict[str, BagFault] = {
    "gyro_sign": BagFault(IMU, _gyro_sign, "the gyroscope turns the other way"),
    "no_gravity": BagFault(IMU, _no_gravity, "accelerations lack gravity"),
    "mirrored_scan": BagFault(CLOUD, _mirrored, "clouds are mirrored, left for right"),
    "long_ranges": BagFault(CLOUD, _stretched, "ranges are 10 % too long"),
    "no_times": BagFault(CLOUD, _no_times, "the times of points are 0"),
    "wrong_mount": BagFault(TF, _tilted, "the LiDAR's mount is 5 degrees off", (TF_STATIC_TOPIC,)),
    "late_stamps": BagFault(CLOUD, _late, "clouds are stamped 50 ms late"),
}
"""By name."""


def with_fault(bag: Path, out: Path, fault: BagFault) -> int:
    """Write a bag with a fault; return the number of changed messages.

    Parameters
    ----------
    bag
        MCAP file with ROS 2 messages.
    out
        path of the new file.
    """
    changed = 0
    file = RosFile(out)
    with bag.open("rb") as stream:
        reader = SeekingReader(stream)
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            body = message.data
            if schema.name == fault.ros_type and (
                not fault.topics or channel.topic in fault.topics
            ):
                body = apply_fault(body, fault)
                changed += 1
            latched = channel.topic == TF_STATIC_TOPIC
            topic = file.topic(channel.topic, schema.name, latched=latched)
            topic.write(message.log_time, memoryview(body))
    file.commit({})
    file.close()
    return changed


def apply_fault(cdr: bytes, fault: BagFault) -> bytes:
    """Return a message with a fault applied."""
    message: Any = STORE.deserialize_cdr(cdr, fault.ros_type)
    fault.spoil(message)
    return bytes(STORE.serialize_cdr(message, fault.ros_type))


def _records(cloud: Any) -> NDArray[np.void]:
    """Return a cloud's points as records that can be written to."""
    formats = {4: "<u2", 6: "<u4", 7: "<f4"}
    record = np.dtype(
        {
            "names": [field.name for field in cloud.fields],
            "formats": [formats[field.datatype] for field in cloud.fields],
            "offsets": [field.offset for field in cloud.fields],
            "itemsize": cloud.point_step,
        }
    )
    cloud.data = np.array(cloud.data)
    points: NDArray[np.void] = cloud.data.view(record)
    return points
