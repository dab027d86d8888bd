# SPDX-License-Identifier: Apache-2.0
"""Bodies as `rosbags` encodes and decodes them: independent of what the node and rclpy do."""

from pathlib import Path
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

ROS_FOLDER = Path(__file__).resolve().parents[2] / "ros"
NANOS = 1_000_000_000
POINT_BYTES = 22

_store = get_typestore(Stores.ROS2_JAZZY)
for _package, _name in (("groundlink_msgs", "WheelEncoders"), ("tf2_msgs", "TFMessage")):
    _definition = (ROS_FOLDER / _package / "msg" / f"{_name}.msg").read_text()
    _store.register(get_types_from_msg(_definition, f"{_package}/msg/{_name}"))


def _new(ros_type: str, **fields: Any) -> Any:
    return _store.types[ros_type](**fields)


def _encode(ros_type: str, **fields: Any) -> bytes:
    return bytes(_store.serialize_cdr(_new(ros_type, **fields), ros_type))


def decode(body: Any, ros_type: str) -> Any:
    return _store.deserialize_cdr(bytes(body), ros_type)


def _header(stamp_nanos: int, frame: str) -> Any:
    sec, nanosec = divmod(stamp_nanos, NANOS)
    stamp = _new("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
    return _new("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def _vector(x: float, y: float, z: float) -> Any:
    return _new("geometry_msgs/msg/Vector3", x=x, y=y, z=z)


def _identity() -> Any:
    return _new("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)


def cloud(stamp_nanos: int, data: bytes, frame: str = "lidar") -> bytes:
    points = len(data) // POINT_BYTES
    return _encode(
        "sensor_msgs/msg/PointCloud2",
        header=_header(stamp_nanos, frame),
        height=1,
        width=points,
        fields=[],
        is_bigendian=False,
        point_step=POINT_BYTES,
        row_step=points * POINT_BYTES,
        data=np.frombuffer(data, np.uint8),
        is_dense=True,
    )


def imu(stamp_nanos: int, x: float = 0.0, frame: str = "imu") -> bytes:
    unknown = np.zeros(9)
    return _encode(
        "sensor_msgs/msg/Imu",
        header=_header(stamp_nanos, frame),
        orientation=_identity(),
        orientation_covariance=unknown,
        angular_velocity=_vector(0.0, 0.0, 0.0),
        angular_velocity_covariance=unknown,
        linear_acceleration=_vector(x, 0.0, 9.81),
        linear_acceleration_covariance=unknown,
    )


def wheels(stamp_nanos: int, names: list[str], ticks: list[int]) -> bytes:
    return _encode(
        "groundlink_msgs/msg/WheelEncoders",
        header=_header(stamp_nanos, "base_link"),
        name=names,
        ticks=np.array(ticks, np.int64),
    )


def clock(stamp_nanos: int) -> bytes:
    sec, nanosec = divmod(stamp_nanos, NANOS)
    time = _new("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
    return _encode("rosgraph_msgs/msg/Clock", clock=time)


def transforms(stamp_nanos: int, x_of_children: dict[str, float]) -> bytes:
    return _encode(
        "tf2_msgs/msg/TFMessage",
        transforms=[
            _new(
                "geometry_msgs/msg/TransformStamped",
                header=_header(stamp_nanos, "base_link"),
                child_frame_id=child,
                transform=_new(
                    "geometry_msgs/msg/Transform",
                    translation=_vector(x, 0.0, 0.0),
                    rotation=_identity(),
                ),
            )
            for child, x in x_of_children.items()
        ],
    )
