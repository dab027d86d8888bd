# SPDX-License-Identifier: Apache-2.0
"""Recorded ROS messages as the messages of the bus that they were made of.

Rule: the inverse of `ros_messages.to_cdr`, exact in the bytes: what is read here becomes the same
CDR again, bit for bit. It reads what Groundlink wrote; strangers are judged in `ros_incoming`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from rosbags.serde import SerdeError

from groundlink.core.clock import TICK_NANOS
from groundlink.messages import imagery, navigation
from groundlink.messages.base import (
    BadMessage,
    Clock,
    Command,
    Imu,
    M,
    Message,
    PointCloud,
    WheelEncoders,
    packed,
)
from groundlink.messages.faults import Faults
from groundlink.messages.ground_truth import Bodies, TruePoints
from groundlink.messages.missing_readings import Gaps
from groundlink.messages.vitals import Vitals

from .encoding import RECORDED_FORMS
from .faults import from_faults
from .ground_truth import from_bodies
from .missing_readings import from_gaps
from .types import STORE, nanos, xyz, xyzw
from .vitals import from_vitals


@dataclass(frozen=True)
class Moment:
    """What a message of the bus says and its ROS type does not."""

    nanos: int
    """The run's time when it was recorded."""

    epoch_nanos: int


def from_cdr(cdr: bytes | memoryview, message_type: type[M], moment: Moment) -> M:
    """Return the message whose CDR this is.

    Raises
    ------
    BadMessage
        when it is no message of this type.
    """
    ros_type = RECORDED_FORMS[message_type].ros_type
    try:
        found: M = _READINGS[message_type](STORE.deserialize_cdr(cdr, ros_type), moment)
    except (SerdeError, ValueError, KeyError) as error:
        raise BadMessage(f"no {message_type.__name__} in this {ros_type}: {error}") from None
    return found


def _stamp_and_frame(message: Any) -> tuple[int, str]:
    return nanos(message.header.stamp), message.header.frame_id


def _clock(ros: Any, moment: Moment) -> Clock:
    stamp = nanos(ros.clock)
    epoch = moment.epoch_nanos
    return Clock(stamp, epoch, (stamp - epoch) // TICK_NANOS, life=epoch)


def _command(ros: Any, moment: Moment) -> Command:
    return Command(moment.nanos, xyz(ros.linear), xyz(ros.angular))


def _imu(ros: Any, moment: Moment) -> Imu:
    return Imu(
        *_stamp_and_frame(ros),
        xyzw(ros.orientation),
        xyz(ros.angular_velocity),
        xyz(ros.linear_acceleration),
        float(ros.orientation_covariance[0]),
        float(ros.angular_velocity_covariance[0]),
        float(ros.linear_acceleration_covariance[0]),
    )


def _point_cloud(ros: Any, moment: Moment) -> PointCloud:
    return PointCloud(*_stamp_and_frame(ros), packed(ros.data))


def _true_points(ros: Any, moment: Moment) -> TruePoints:
    return TruePoints(*_stamp_and_frame(ros), packed(ros.data))


def _wheel_encoders(ros: Any, moment: Moment) -> WheelEncoders:
    return WheelEncoders(*_stamp_and_frame(ros), tuple(ros.name), tuple(ros.ticks.tolist()))


def _image(ros: Any, moment: Moment) -> imagery.Image:
    return imagery.Image(
        *_stamp_and_frame(ros), ros.height, ros.width, ros.encoding, ros.step, packed(ros.data)
    )


def _compressed_image(ros: Any, moment: Moment) -> imagery.CompressedImage:
    return imagery.CompressedImage(*_stamp_and_frame(ros), ros.format, packed(ros.data))


def _camera_info(ros: Any, moment: Moment) -> imagery.CameraInfo:
    return imagery.CameraInfo(
        *_stamp_and_frame(ros),
        ros.height,
        ros.width,
        ros.distortion_model,
        *(packed(matrix) for matrix in (ros.d, ros.k, ros.r, ros.p)),
    )


def _laser_scan(ros: Any, moment: Moment) -> imagery.LaserScan:
    return imagery.LaserScan(
        *_stamp_and_frame(ros),
        ros.angle_min,
        ros.angle_increment,
        ros.time_increment,
        ros.scan_time,
        ros.range_min,
        ros.range_max,
        packed(ros.ranges),
        packed(ros.intensities),
    )


def _range(ros: Any, moment: Moment) -> imagery.Range:
    return imagery.Range(
        *_stamp_and_frame(ros),
        "infrared" if ros.radiation_type else "ultrasound",
        ros.field_of_view,
        ros.min_range,
        ros.max_range,
        ros.range,
        ros.variance,
    )


def _pose_stamped(ros: Any, moment: Moment) -> navigation.PoseStamped:
    pose = ros.pose
    return navigation.PoseStamped(
        *_stamp_and_frame(ros), xyz(pose.position), xyzw(pose.orientation)
    )


def _odometry(ros: Any, moment: Moment) -> navigation.Odometry:
    pose, twist = ros.pose, ros.twist
    return navigation.Odometry(
        *_stamp_and_frame(ros),
        ros.child_frame_id,
        xyz(pose.pose.position),
        xyzw(pose.pose.orientation),
        xyz(twist.twist.linear),
        xyz(twist.twist.angular),
        packed(pose.covariance),
        packed(twist.covariance),
    )


def _occupancy_grid(ros: Any, moment: Moment) -> navigation.OccupancyGrid:
    info = ros.info
    return navigation.OccupancyGrid(
        *_stamp_and_frame(ros),
        nanos(info.map_load_time),
        info.resolution,
        info.width,
        info.height,
        xyz(info.origin.position),
        xyzw(info.origin.orientation),
        packed(np.asarray(ros.data, np.int8)),
    )


def _transforms(ros: Any, moment: Moment) -> navigation.Transforms:
    return navigation.Transforms(
        tuple(
            navigation.Transform(
                *_stamp_and_frame(one),
                one.child_frame_id,
                xyz(one.transform.translation),
                xyzw(one.transform.rotation),
            )
            for one in ros.transforms
        )
    )


def _joint_state(ros: Any, moment: Moment) -> navigation.JointState:
    arrays = (packed(numbers) for numbers in (ros.position, ros.velocity, ros.effort))
    return navigation.JointState(*_stamp_and_frame(ros), tuple(ros.name), *arrays)


def _text(ros: Any, moment: Moment) -> navigation.Text:
    return navigation.Text(moment.nanos, ros.data)


def _nav_sat_fix(ros: Any, moment: Moment) -> navigation.NavSatFix:
    return navigation.NavSatFix(
        *_stamp_and_frame(ros),
        ros.status.status,
        ros.status.service,
        ros.latitude,
        ros.longitude,
        ros.altitude,
        packed(ros.position_covariance),
        ros.position_covariance_type,
    )


def _bodies(ros: Any, moment: Moment) -> Bodies:
    return from_bodies(ros)


def _faults(ros: Any, moment: Moment) -> Faults:
    return from_faults(ros, nanos(ros.header.stamp))


def _gaps(ros: Any, moment: Moment) -> Gaps:
    return from_gaps(ros, nanos(ros.header.stamp))


def _vitals(ros: Any, moment: Moment) -> Vitals:
    return from_vitals(ros, nanos(ros.header.stamp))


_READINGS: dict[type[Message], Callable[[Any, Moment], Any]] = {
    Clock: _clock,
    Command: _command,
    Imu: _imu,
    PointCloud: _point_cloud,
    TruePoints: _true_points,
    WheelEncoders: _wheel_encoders,
    imagery.Image: _image,
    imagery.CompressedImage: _compressed_image,
    imagery.CameraInfo: _camera_info,
    imagery.LaserScan: _laser_scan,
    imagery.Range: _range,
    navigation.PoseStamped: _pose_stamped,
    navigation.Odometry: _odometry,
    navigation.OccupancyGrid: _occupancy_grid,
    navigation.Transforms: _transforms,
    navigation.JointState: _joint_state,
    navigation.Text: _text,
    navigation.NavSatFix: _nav_sat_fix,
    Bodies: _bodies,
    Vitals: _vitals,
    Faults: _faults,
    Gaps: _gaps,
}
"""By message of the bus: from its ROS message back to it. The table of `ros_messages`, reversed."""
