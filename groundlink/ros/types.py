# SPDX-License-Identifier: Apache-2.0
"""ROS 2 message definitions, and conversions of parts that many messages share.

ROS types come from definitions (`rosbags`), so no ROS installation is needed. This module is
independent of the messages of the bus.
"""

import struct
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from groundlink.core.clock import NANOS
from groundlink.core.fields import Quaternion, Vector3

WHEEL_ENCODERS_DEFINITION = """\
std_msgs/Header header
string[] name
int64[] ticks
"""
"""Definition of groundlink_msgs/msg/WheelEncoders. The commented file is in `ros/groundlink_msgs`.
"""

STORE = get_typestore(Stores.ROS2_KILTED)
TYPES = STORE.types


def register_unknown(definitions: Mapping[str, str], store: Typestore = STORE) -> None:
    """Register the types among these that a store lacks, each with the types in its definition.

    A definition that cannot be parsed is left out.
    """
    for ros_type, text in definitions.items():
        if ros_type in store.types:
            continue
        with suppress(TypesysError):
            found = get_types_from_msg(text, ros_type)
            store.register(
                {name: fields for name, fields in found.items() if name not in store.types}
            )


register_unknown({"groundlink_msgs/msg/WheelEncoders": WHEEL_ENCODERS_DEFINITION})

_FLOAT32 = struct.Struct("<f")


def time(nanos: int) -> Any:
    """Return builtin_interfaces/Time."""
    return TYPES["builtin_interfaces/msg/Time"](sec=nanos // NANOS, nanosec=nanos % NANOS)


def nanos(time: Any) -> int:
    """Return the nanoseconds of a builtin_interfaces/Time."""
    return int(time.sec) * NANOS + int(time.nanosec)


def header(stamp_nanos: int, frame: str) -> Any:
    """Return std_msgs/Header."""
    return TYPES["std_msgs/msg/Header"](stamp=time(stamp_nanos), frame_id=frame)


def vector(xyz: Vector3) -> Any:
    """Return geometry_msgs/Vector3."""
    return TYPES["geometry_msgs/msg/Vector3"](x=xyz[0], y=xyz[1], z=xyz[2])


def quaternion(xyzw: Quaternion) -> Any:
    """Return geometry_msgs/Quaternion."""
    x, y, z, w = xyzw
    return TYPES["geometry_msgs/msg/Quaternion"](x=x, y=y, z=z, w=w)


def pose(position_m: Vector3, orientation: Quaternion) -> Any:
    """Return geometry_msgs/Pose."""
    x, y, z = position_m
    return TYPES["geometry_msgs/msg/Pose"](
        position=TYPES["geometry_msgs/msg/Point"](x=x, y=y, z=z),
        orientation=quaternion(orientation),
    )


def xyz(vector: Any) -> Vector3:
    """Return the components of a Vector3 or a Point."""
    return vector.x, vector.y, vector.z


def xyzw(quaternion: Any) -> Quaternion:
    """Return the components of a Quaternion."""
    return quaternion.x, quaternion.y, quaternion.z, quaternion.w


def float32(number: float) -> float:
    """Return a number rounded to float32. Raises OverflowError if it is out of range."""
    rounded: float = _FLOAT32.unpack(_FLOAT32.pack(number))[0]
    return rounded


def array(packed: memoryview, dtype: Any) -> NDArray[Any]:
    """Return the numbers of a bin as a view."""
    return np.frombuffer(packed, dtype)


DEFINITION_ENCODING = "ros2msg"
"""Encoding name of type definitions in MCAP files and Foxglove's protocol."""

MESSAGE_ENCODING = "cdr"
"""Encoding name of messages in MCAP files and Foxglove's protocol."""


@cache
def definition(ros_type: str) -> str:
    """Return the full definition of a type such as `sensor_msgs/msg/Imu`.

    The type's own fields come first, followed by those of every type that it contains.
    """
    text, _ = STORE.generate_msgdef(ros_type, ros_version=2)
    return text
