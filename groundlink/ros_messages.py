# SPDX-License-Identifier: Apache-2.0
"""How each message of the bus becomes a ROS 2 message, as CDR bytes, and back.

Rule: the one place that fills ROS messages; gateway, recorder and viewer share it. It knows ROS by
its message definitions alone (`rosbags`), so no ROS is needed where it runs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from .clock import NANOS
from .messages import (
    POINT,
    BadMessage,
    Clock,
    Imu,
    Message,
    PointCloud,
    Quaternion,
    Vector3,
    WheelEncoders,
)

WHEEL_ENCODERS_DEFINITION = """\
std_msgs/Header header
string[] name
int64[] ticks
"""
"""Fields of groundlink_msgs/msg/WheelEncoders; `ros/groundlink_msgs` has the documented file."""

_STORE = get_typestore(Stores.ROS2_KILTED)
_STORE.register(get_types_from_msg(WHEEL_ENCODERS_DEFINITION, "groundlink_msgs/msg/WheelEncoders"))
_TYPES = _STORE.types
_Time = _TYPES["builtin_interfaces/msg/Time"]
_Header = _TYPES["std_msgs/msg/Header"]
_Vector3 = _TYPES["geometry_msgs/msg/Vector3"]
_Quaternion = _TYPES["geometry_msgs/msg/Quaternion"]
_Transform = _TYPES["geometry_msgs/msg/Transform"]
_TransformStamped = _TYPES["geometry_msgs/msg/TransformStamped"]
_PointField = _TYPES["sensor_msgs/msg/PointField"]

_POINT_FIELD_TYPES = {"<f4": 7, "<u2": 4}
"""sensor_msgs/PointField's FLOAT32 and UINT16."""


@dataclass(frozen=True)
class StaticTransform:
    """parent_from_child, which never changes."""

    parent: str
    child: str
    translation_m: Vector3
    rotation: Quaternion


def _time(stamp_nanos: int) -> Any:
    return _Time(sec=stamp_nanos // NANOS, nanosec=stamp_nanos % NANOS)


def _header(stamp_nanos: int, frame: str) -> Any:
    return _Header(stamp=_time(stamp_nanos), frame_id=frame)


def _vector(xyz: Vector3) -> Any:
    return _Vector3(x=xyz[0], y=xyz[1], z=xyz[2])


def _quaternion(xyzw: Quaternion) -> Any:
    return _Quaternion(x=xyzw[0], y=xyzw[1], z=xyzw[2], w=xyzw[3])


def _diagonal(variance: float) -> np.ndarray[Any, Any]:
    return np.diag(np.full(3, variance, np.float64)).ravel()


_POINT_FIELDS = [
    _PointField(name=name, offset=offset, datatype=_POINT_FIELD_TYPES[POINT[name].str], count=1)
    for name, (_, offset, *_) in (POINT.fields or {}).items()
]


def _clock(message: Clock) -> dict[str, Any]:
    return {"clock": _time(message.stamp_nanos)}


def _imu(message: Imu) -> dict[str, Any]:
    return {
        "header": _header(message.stamp_nanos, message.frame),
        "orientation": _quaternion(message.orientation),
        "orientation_covariance": _diagonal(message.orientation_variance),
        "angular_velocity": _vector(message.angular_velocity_radps),
        "angular_velocity_covariance": _diagonal(message.angular_velocity_variance),
        "linear_acceleration": _vector(message.linear_acceleration_mps2),
        "linear_acceleration_covariance": _diagonal(message.linear_acceleration_variance),
    }


def _point_cloud(message: PointCloud) -> dict[str, Any]:
    data = np.frombuffer(message.points, np.uint8)
    return {
        "header": _header(message.stamp_nanos, message.frame),
        "height": 1,
        "width": data.size // POINT.itemsize,
        "fields": _POINT_FIELDS,
        "is_bigendian": False,
        "point_step": POINT.itemsize,
        "row_step": data.size,
        "data": data,
        "is_dense": True,
    }


def _wheel_encoders(message: WheelEncoders) -> dict[str, Any]:
    return {
        "header": _header(message.stamp_nanos, message.frame),
        "name": list(message.names),
        "ticks": np.array(message.ticks, np.int64),
    }


@dataclass(frozen=True)
class RosForm:
    """The ROS type of a message of the bus and how its fields are filled."""

    ros_type: str
    fields: Callable[[Any], dict[str, Any]]


ROS_FORMS: dict[type[Message], RosForm] = {
    Clock: RosForm("rosgraph_msgs/msg/Clock", _clock),
    Imu: RosForm("sensor_msgs/msg/Imu", _imu),
    PointCloud: RosForm("sensor_msgs/msg/PointCloud2", _point_cloud),
    WheelEncoders: RosForm("groundlink_msgs/msg/WheelEncoders", _wheel_encoders),
}
"""Every message of the bus that ROS sees."""


def to_cdr(message: Message) -> memoryview:
    """Return a message as its ROS type's CDR, encapsulation header included."""
    form = ROS_FORMS[type(message)]
    return _STORE.serialize_cdr(_TYPES[form.ros_type](**form.fields(message)), form.ros_type)


def transforms_to_cdr(transforms: Iterable[StaticTransform], stamp_nanos: int) -> memoryview:
    """Return tf2_msgs/TFMessage as CDR."""
    stamped = [
        _TransformStamped(
            header=_header(stamp_nanos, t.parent),
            child_frame_id=t.child,
            transform=_Transform(
                translation=_vector(t.translation_m), rotation=_quaternion(t.rotation)
            ),
        )
        for t in transforms
    ]
    message = _TYPES["tf2_msgs/msg/TFMessage"](transforms=stamped)
    return _STORE.serialize_cdr(message, "tf2_msgs/msg/TFMessage")


def twist_from_cdr(body: bytes | bytearray | memoryview) -> tuple[Vector3, Vector3]:
    """Return linear (m/s) and angular (rad/s) velocity of a geometry_msgs/Twist.

    Raises
    ------
    BadMessage
        when the bytes are no Twist or hold numbers that are not finite.
    """
    try:
        twist: Any = _STORE.deserialize_cdr(bytes(body), "geometry_msgs/msg/Twist")
    except SerdeError as error:
        raise BadMessage(f"not a geometry_msgs/Twist: {error}") from None
    linear = (twist.linear.x, twist.linear.y, twist.linear.z)
    angular = (twist.angular.x, twist.angular.y, twist.angular.z)
    if not all(map(math.isfinite, (*linear, *angular))):
        raise BadMessage("not a geometry_msgs/Twist: a component is not finite")
    return linear, angular
