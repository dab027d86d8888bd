# SPDX-License-Identifier: Apache-2.0
"""How each message of the bus becomes a ROS 2 message, as CDR bytes.

Rule: the one table of ROS types; gateway, recorder and viewer share it. It fills the run's own
messages; those of `imagery` and `navigation` are filled in `ros_imagery` and `ros_navigation`, and
what comes from ROS is read in `ros_incoming`.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from rosbags.serde import SerdeError

from groundlink.messages import imagery, navigation
from groundlink.messages.base import (
    POINT,
    BadMessage,
    Clock,
    Command,
    Imu,
    Message,
    PointCloud,
    WheelEncoders,
)
from groundlink.messages.faults import Faults
from groundlink.messages.ground_truth import TRUE_POINT, Bodies, TruePoints
from groundlink.messages.missing_readings import Gaps
from groundlink.messages.relayed import Relayed
from groundlink.messages.vitals import Vitals

from . import faults as ros_faults
from . import ground_truth as ros_ground_truth
from . import imagery as ros_imagery
from . import missing_readings as ros_gaps
from . import navigation as ros_navigation
from . import vitals as ros_vitals
from .types import STORE, TYPES, header, quaternion, time, vector

_POINT_FIELD_TYPES = {"<f4": 7, "<u2": 4, "<u4": 6}
"""sensor_msgs/PointField's FLOAT32, UINT16 and UINT32."""


@lru_cache(maxsize=256)
def _diagonal(variance: float) -> np.ndarray[Any, Any]:
    covariance = np.diag(np.full(3, variance, np.float64)).ravel()
    covariance.setflags(write=False)
    return covariance


_POINT_FIELDS = {
    record: [
        TYPES["sensor_msgs/msg/PointField"](
            name=name, offset=offset, datatype=_POINT_FIELD_TYPES[record[name].str], count=1
        )
        for name, (_, offset, *_) in (record.fields or {}).items()
    ]
    for record in (POINT, TRUE_POINT)
}


def _clock(message: Clock) -> dict[str, Any]:
    return {"clock": time(message.stamp_nanos)}


def _twist(message: Command) -> dict[str, Any]:
    return {
        "linear": vector(message.linear_mps),
        "angular": vector(message.angular_radps),
    }


def _imu(message: Imu) -> dict[str, Any]:
    return {
        "header": header(message.stamp_nanos, message.frame),
        "orientation": quaternion(message.orientation),
        "orientation_covariance": _diagonal(message.orientation_variance),
        "angular_velocity": vector(message.angular_velocity_radps),
        "angular_velocity_covariance": _diagonal(message.angular_velocity_variance),
        "linear_acceleration": vector(message.linear_acceleration_mps2),
        "linear_acceleration_covariance": _diagonal(message.linear_acceleration_variance),
    }


def _point_cloud(message: PointCloud | TruePoints) -> dict[str, Any]:
    data = np.frombuffer(message.points, np.uint8)
    record = message.records().dtype
    return {
        "header": header(message.stamp_nanos, message.frame),
        "height": 1,
        "width": data.size // record.itemsize,
        "fields": _POINT_FIELDS[record],
        "is_bigendian": False,
        "point_step": record.itemsize,
        "row_step": data.size,
        "data": data,
        "is_dense": True,
    }


def _wheel_encoders(message: WheelEncoders) -> dict[str, Any]:
    return {
        "header": header(message.stamp_nanos, message.frame),
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
    Command: RosForm("geometry_msgs/msg/Twist", _twist),
    Imu: RosForm("sensor_msgs/msg/Imu", _imu),
    PointCloud: RosForm("sensor_msgs/msg/PointCloud2", _point_cloud),
    TruePoints: RosForm("sensor_msgs/msg/PointCloud2", _point_cloud),
    WheelEncoders: RosForm("groundlink_msgs/msg/WheelEncoders", _wheel_encoders),
    imagery.Image: RosForm("sensor_msgs/msg/Image", ros_imagery.image),
    imagery.CompressedImage: RosForm(
        "sensor_msgs/msg/CompressedImage", ros_imagery.compressed_image
    ),
    imagery.CameraInfo: RosForm("sensor_msgs/msg/CameraInfo", ros_imagery.camera_info),
    imagery.LaserScan: RosForm("sensor_msgs/msg/LaserScan", ros_imagery.laser_scan),
    imagery.Range: RosForm("sensor_msgs/msg/Range", ros_imagery.range_reading),
    navigation.PoseStamped: RosForm("geometry_msgs/msg/PoseStamped", ros_navigation.pose_stamped),
    navigation.Odometry: RosForm("nav_msgs/msg/Odometry", ros_navigation.odometry),
    navigation.OccupancyGrid: RosForm("nav_msgs/msg/OccupancyGrid", ros_navigation.occupancy_grid),
    navigation.Transforms: RosForm("tf2_msgs/msg/TFMessage", ros_navigation.transforms),
    navigation.JointState: RosForm("sensor_msgs/msg/JointState", ros_navigation.joint_state),
    navigation.Text: RosForm("std_msgs/msg/String", ros_navigation.text),
    navigation.NavSatFix: RosForm("sensor_msgs/msg/NavSatFix", ros_navigation.nav_sat_fix),
    Bodies: RosForm("tf2_msgs/msg/TFMessage", ros_ground_truth.bodies),
}
"""Every message of the bus that ROS sees."""

RECORDED_FORMS = ROS_FORMS | {
    Vitals: RosForm("diagnostic_msgs/msg/DiagnosticArray", ros_vitals.vitals),
    Faults: RosForm("diagnostic_msgs/msg/DiagnosticArray", ros_faults.faults),
    Gaps: RosForm("diagnostic_msgs/msg/DiagnosticArray", ros_gaps.gaps),
}
"""Those, and what only a recording holds."""


def ros_type_of(message: type[Message], told: str = "") -> str:
    """Return the ROS type of a stream's messages; `told` is that of what is only relayed."""
    return told if message is Relayed else RECORDED_FORMS[message].ros_type


def to_cdr(message: Message) -> memoryview:
    """Return a message as its ROS type's CDR, encapsulation header included.

    Raises
    ------
    BadMessage
        when a number is beyond what the ROS type holds: a stamp after 2038, a large float32.
    """
    if isinstance(message, Relayed):
        return message.cdr
    form = RECORDED_FORMS[type(message)]
    try:
        return STORE.serialize_cdr(TYPES[form.ros_type](**form.fields(message)), form.ros_type)
    except (struct.error, SerdeError, OverflowError) as error:
        raise BadMessage(
            f"no {form.ros_type} holds this {type(message).__name__}: {error}"
        ) from None
