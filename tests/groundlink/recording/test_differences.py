# SPDX-License-Identifier: Apache-2.0
"""The field in which two messages differ is named, whatever the message is."""

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from groundlink.messages.base import POINT, BusMessage, Imu, PointCloud, WheelEncoders, packed
from groundlink.messages.ground_truth import TRUE_POINT, Bodies, TruePoints
from groundlink.messages.imagery import CompressedImage, Image, LaserScan
from groundlink.messages.navigation import JointState, Odometry
from groundlink.recording.differences import first_difference, message_difference
from groundlink.ros.cdr import CODECS, to_cdr
from groundlink.ros.types import STORE
from tests.groundlink.ros.test_recorded_cdr import ANY

UPRIGHT = (0.0, 0.0, 0.0, 1.0)
STILL = (0.0, 0.0, 0.0)
IMU = Imu(5, "imu_link", UPRIGHT, STILL, (0.0, 0.0, 9.81), 0.0, 0.0, 0.0)
POINTS = np.zeros(1500, POINT)
POINTS["intensity"] = 17.0
CLOUD = PointCloud(5, "lidar_link", packed(POINTS))
PIXELS = np.zeros((4, 6, 3), np.uint8)
PICTURE = Image(5, "camera", 4, 6, "rgb8", 18, packed(PIXELS))
DEPTH = Image(5, "camera", 2, 2, "32FC1", 8, packed(np.ones((2, 2), np.float32)))
RANGES = np.linspace(1, 2, 9, dtype=np.float32)
SCAN = LaserScan(5, "scan", -1.0, 0.1, 0.0, 0.1, 0.1, 9.0, packed(RANGES), memoryview(b""))
COVARIANCE = np.zeros(36)
TRUTH = Odometry(
    *(5, "world", "base_link", STILL, UPRIGHT, STILL, STILL),
    *(packed(COVARIANCE), packed(COVARIANCE)),
)
WHEELS = np.array([1.0, 2.0])
JOINTS = JointState(5, "base", ("left", "right"), packed(WHEELS), packed(WHEELS), packed(WHEELS))
BODIES = Bodies(5, ("wall", "box"), packed(np.zeros(14)))


def changed(array: Any, where: Any, value: float) -> memoryview:
    copy = array.copy()
    copy[where] = value
    return packed(copy)


def of_points(where: Any, field: str, value: float) -> PointCloud:
    copy = POINTS.copy()
    copy[field][where] = value
    return replace(CLOUD, points=packed(copy))


def pair(message: BusMessage, **changes: Any) -> tuple[BusMessage, BusMessage]:
    return message, replace(message, **changes)


CASES: dict[str, tuple[BusMessage, BusMessage]] = {
    "linear_acceleration.x: 0.0 recorded, 0.1 repeated": pair(
        IMU, linear_acceleration_mps2=(0.1, 0.0, 9.82)
    ),
    "header.stamp.nanosec: 5 recorded, 2500005 repeated": pair(IMU, stamp_nanos=2_500_005),
    "header.frame_id: `imu_link` recorded, `imu` repeated": pair(IMU, frame="imu"),
    "linear_acceleration.z: 9.81 recorded, 9.810000000000002 repeated": pair(
        IMU, linear_acceleration_mps2=(0.0, 0.0, np.nextafter(9.81, 10))
    ),
    "linear_acceleration.x: 0.0 recorded, 0.3333333333333333 repeated": pair(
        IMU, linear_acceleration_mps2=(1 / 3, 0.0, 9.81)
    ),
    "angular_velocity.y: 0.0 recorded, -0.0 repeated": pair(
        IMU, angular_velocity_radps=(0.0, -0.0, 0.0)
    ),
    "orientation_covariance[0]: 0.0 recorded, 0.25 repeated; 3 of 9 numbers differ": pair(
        IMU, orientation_variance=0.25
    ),
    "pose.pose.position.x: 0.0 recorded, 1.5 repeated": pair(TRUTH, position_m=(1.5, 0.0, 0.0)),
    "twist.covariance[7]: 0.0 recorded, 2.0 repeated; 1 of 36 numbers differ": pair(
        TRUTH, twist_covariance=changed(COVARIANCE, 7, 2.0)
    ),
    "data: point 1284, field intensity: 17.0 recorded, 18.0 repeated; 1 of 1500 points differ": (
        CLOUD,
        of_points(1284, "intensity", 18.0),
    ),
    "data: point 3, field ring: 0 recorded, 7 repeated; 7 of 1500 points differ": (
        CLOUD,
        of_points(slice(3, 10), "ring", 7),
    ),
    "width: 1500 recorded, 1499 repeated": pair(CLOUD, points=packed(POINTS[1:])),
    f"data: point 1, field {(TRUE_POINT.names or ())[0]}: 0.0 recorded, 1e-45 repeated; "
    "1 of 3 points differ": pair(
        TruePoints(5, "lidar_link", packed(np.zeros(3, TRUE_POINT))),
        points=changed(np.zeros(3, TRUE_POINT).view(np.uint8), TRUE_POINT.itemsize, 1),
    ),
    "data: pixel in row 2, column 4, g: 0 recorded, 9 repeated; 1 of 24 pixels differ": pair(
        PICTURE, data=changed(PIXELS, (2, 4, 1), 9)
    ),
    "data: pixel in row 1, column 0: 1.0 recorded, 1.1 repeated; 1 of 4 pixels differ": pair(
        DEPTH, data=changed(np.ones((2, 2), np.float32), (1, 0), 1.1)
    ),
    "data: byte 49 of 72: 0 recorded, 9 repeated": pair(
        replace(PICTURE, encoding="yuv422"), data=changed(PIXELS, (2, 4, 1), 9)
    ),
    "data: 7 bytes recorded, 8 bytes repeated; equal up to byte 2": pair(
        CompressedImage(5, "camera", "jpeg", memoryview(b"abcdefg")), data=memoryview(b"abCdefgh")
    ),
    "ranges[4]: 1.5 recorded, 1.7 repeated; 1 of 9 numbers differ": pair(
        SCAN, ranges_m=changed(RANGES, 4, 1.7)
    ),
    "ranges[4]: 1.5 recorded, inf repeated; 1 of 9 numbers differ": pair(
        SCAN, ranges_m=changed(RANGES, 4, np.inf)
    ),
    "intensities: 0 numbers recorded, 9 numbers repeated": pair(SCAN, intensities=packed(RANGES)),
    "ticks[1] (right): 4 recorded, 5 repeated; 1 of 2 numbers differ": pair(
        WheelEncoders(5, "base", ("left", "right"), (3, 4)), ticks=(3, 5)
    ),
    "velocity[0] (left): 1.0 recorded, 1.25 repeated; 1 of 2 numbers differ": pair(
        JOINTS, velocities=changed(WHEELS, 0, 1.25)
    ),
    "transforms[1].transform.translation.y (box): 0.0 recorded, 3.0 repeated": pair(
        BODIES, poses=changed(np.zeros(14), 8, 3.0)
    ),
    "transforms: 2 elements recorded, 1 elements repeated": pair(
        BODIES, names=("wall",), poses=packed(np.zeros(7))
    ),
}


@pytest.mark.parametrize("words", CASES)
def test_the_field_is_named_with_both_values(words: str) -> None:
    recorded, again = CASES[words]
    ros_type = CODECS[type(recorded)].ros_type
    found = message_difference(ros_type, bytes(to_cdr(recorded)), bytes(to_cdr(again)))
    assert str(found) == words


def leaves(message: Any, path: str = "") -> Iterator[tuple[str, Any, str]]:
    """Yield the path, the owner and the attribute of every number and text of a ROS message."""
    for field in dataclasses.fields(message):
        value, inner = getattr(message, field.name), f"{path}{field.name}"
        if dataclasses.is_dataclass(value):
            yield from leaves(value, f"{inner}.")
        elif isinstance(value, list):
            for i, part in enumerate(value):
                if dataclasses.is_dataclass(part):
                    yield from leaves(part, f"{inner}[{i}].")
        elif field.name[0] != "_" and not field.name.isupper():  # constants
            yield inner, message, field.name


@settings(max_examples=100)
@given(data=st.data())
def test_whatever_single_field_is_changed_is_found(data: Any) -> None:
    """In every kind of message that a recording holds."""
    message = data.draw(st.sampled_from(list(ANY)).flatmap(lambda kind: ANY[kind]))
    ros_type = CODECS[type(message)].ros_type
    recorded = bytes(to_cdr(message))
    decoded = STORE.deserialize_cdr(recorded, ros_type)
    path, owner, name = data.draw(st.sampled_from([*leaves(decoded)]))
    value = getattr(owner, name)
    if isinstance(value, np.ndarray):
        if not len(value):
            return
        value = value.copy()
        flat = value.view(np.uint8)
        flat[data.draw(st.integers(0, len(flat) - 1))] ^= 1
    elif isinstance(value, float):
        value = 2.5 if value == 1.5 else 1.5
    else:
        value = value + "x" if isinstance(value, str) else not value
    setattr(owner, name, value)
    again = bytes(STORE.serialize_cdr(decoded, ros_type))
    found = message_difference(ros_type, recorded, again)
    assert found.field.startswith(path), found


def test_bytes_that_are_no_message_any_more_are_still_placed() -> None:
    recorded = bytes(to_cdr(IMU))
    again = bytearray(recorded)
    again[12] ^= 0x80  # the length of the frame's name: beyond the end
    again[13] ^= 0x80
    found = message_difference("sensor_msgs/msg/Imu", recorded, bytes(again))
    assert str(found) == f"body: byte 12 of {len(recorded)}: 9 recorded, 137 repeated"


def test_bytes_between_fields_are_placed() -> None:
    recorded = bytes(to_cdr(replace(IMU, frame="imu_")))
    again = bytearray(recorded)
    again[22] ^= 1  # what aligns the orientation behind the name
    found = message_difference("sensor_msgs/msg/Imu", recorded, bytes(again))
    assert found.field == f"body: byte 22 of {len(recorded)}"


def test_of_dicts_and_lists_the_first_difference_is_named() -> None:
    was = {"seed": 1, "vehicles": [{"name": "rover", "sensors": [{"name": "imu", "noise": 0.1}]}]}
    now = {"seed": 1, "vehicles": [{"name": "rover", "sensors": [{"name": "imu", "noise": 0.2}]}]}
    found = first_difference(was, now)
    assert str(found) == "vehicles[0].sensors[0].noise (rover, imu): 0.1 recorded, 0.2 repeated"
    assert first_difference(was, was) is None
    assert str(first_difference({"route": None}, {"route": 1})) == (
        "route: nothing recorded, 1 repeated"
    )
