# SPDX-License-Identifier: Apache-2.0
"""Codecs of poses, odometry, maps, transforms, joint states, texts and satellite fixes."""

from typing import Any

import numpy as np

from groundlink.messages.base import BadBusMessage, packed
from groundlink.messages.navigation import (
    JointState,
    NavSatFix,
    OccupancyGrid,
    Odometry,
    PoseStamped,
    Text,
    Transform,
    Transforms,
)

from .codec import (
    Codec,
    Moment,
    check_finite,
    checked_name,
    checked_nanos,
    checked_stamp_and_frame,
    checked_unit,
    stamp_and_frame,
)
from .joint_commands import joint_command
from .types import TYPES, array, header, nanos, pose, quaternion, time, vector, xyz, xyzw


def _pose_stamped(message: PoseStamped) -> dict[str, Any]:
    return {
        "header": header(message.stamp_nanos, message.frame),
        "pose": pose(message.position_m, message.orientation),
    }


def _pose_stamped_of(ros: Any, moment: Moment) -> PoseStamped:
    return PoseStamped(*stamp_and_frame(ros), xyz(ros.pose.position), xyzw(ros.pose.orientation))


def _read_pose_stamped(ros: Any, now_nanos: int) -> PoseStamped:
    position, orientation = xyz(ros.pose.position), checked_unit(xyzw(ros.pose.orientation))
    check_finite(*position)
    return PoseStamped(*checked_stamp_and_frame(ros.header), position, orientation)


def _odometry(message: Odometry) -> dict[str, Any]:
    twist = TYPES["geometry_msgs/msg/Twist"](
        linear=vector(message.linear_mps), angular=vector(message.angular_radps)
    )
    return {
        "header": header(message.stamp_nanos, message.frame),
        "child_frame_id": message.child_frame,
        "pose": TYPES["geometry_msgs/msg/PoseWithCovariance"](
            pose=pose(message.position_m, message.orientation),
            covariance=array(message.pose_covariance, np.float64),
        ),
        "twist": TYPES["geometry_msgs/msg/TwistWithCovariance"](
            twist=twist, covariance=array(message.twist_covariance, np.float64)
        ),
    }


def _odometry_of(ros: Any, moment: Moment) -> Odometry:
    pose, twist = ros.pose, ros.twist
    return Odometry(
        *stamp_and_frame(ros),
        ros.child_frame_id,
        xyz(pose.pose.position),
        xyzw(pose.pose.orientation),
        xyz(twist.twist.linear),
        xyz(twist.twist.angular),
        packed(pose.covariance),
        packed(twist.covariance),
    )


def _read_odometry(ros: Any, now_nanos: int) -> Odometry:
    pose, twist = ros.pose, ros.twist
    position, orientation = xyz(pose.pose.position), checked_unit(xyzw(pose.pose.orientation))
    linear, angular = xyz(twist.twist.linear), xyz(twist.twist.angular)
    check_finite(*position, *linear, *angular, *pose.covariance, *twist.covariance)
    return Odometry(
        *checked_stamp_and_frame(ros.header),
        checked_name(ros.child_frame_id),
        position,
        orientation,
        linear,
        angular,
        packed(pose.covariance),
        packed(twist.covariance),
    )


def _occupancy_grid(message: OccupancyGrid) -> dict[str, Any]:
    return {
        "header": header(message.stamp_nanos, message.frame),
        "info": TYPES["nav_msgs/msg/MapMetaData"](
            map_load_time=time(message.loaded_nanos),
            resolution=message.resolution_m,
            width=message.width,
            height=message.height,
            origin=pose(message.origin_position_m, message.origin_orientation),
        ),
        "data": array(message.cells, np.int8),
    }


def _occupancy_grid_of(ros: Any, moment: Moment) -> OccupancyGrid:
    info = ros.info
    return OccupancyGrid(
        *stamp_and_frame(ros),
        nanos(info.map_load_time),
        info.resolution,
        info.width,
        info.height,
        xyz(info.origin.position),
        xyzw(info.origin.orientation),
        packed(np.asarray(ros.data, np.int8)),
    )


def _read_occupancy_grid(ros: Any, now_nanos: int) -> OccupancyGrid:
    info = ros.info
    cells = np.asarray(ros.data, np.int8)  # Values beyond -1..100 are allowed.
    if info.width * info.height != cells.size:
        raise BadBusMessage(f"{info.width} x {info.height} cells are said, {cells.size} are there")
    position = xyz(info.origin.position)
    check_finite(info.resolution, *position)
    if not info.resolution > 0:
        raise BadBusMessage(f"a resolution of {info.resolution} m")
    return OccupancyGrid(
        *checked_stamp_and_frame(ros.header),
        checked_nanos(info.map_load_time),
        info.resolution,
        info.width,
        info.height,
        position,
        checked_unit(xyzw(info.origin.orientation)),
        packed(cells),
    )


def _transforms(message: Transforms) -> dict[str, Any]:
    stamped = TYPES["geometry_msgs/msg/TransformStamped"]
    transform = TYPES["geometry_msgs/msg/Transform"]
    return {
        "transforms": [
            stamped(
                header=header(t.stamp_nanos, t.parent),
                child_frame_id=t.child,
                transform=transform(
                    translation=vector(t.translation_m), rotation=quaternion(t.rotation)
                ),
            )
            for t in message.transforms
        ]
    }


def _transforms_of(ros: Any, moment: Moment) -> Transforms:
    return Transforms(
        tuple(
            Transform(
                *stamp_and_frame(one),
                one.child_frame_id,
                xyz(one.transform.translation),
                xyzw(one.transform.rotation),
            )
            for one in ros.transforms
        )
    )


def _text(message: Text) -> dict[str, Any]:
    return {"data": message.text}


def _text_of(ros: Any, moment: Moment) -> Text:
    return Text(moment.nanos, ros.data)


def _joint_state(message: JointState) -> dict[str, Any]:
    return {
        "header": header(message.stamp_nanos, message.frame),
        "name": list(message.names),
        "position": array(message.positions, np.float64),
        "velocity": array(message.velocities, np.float64),
        "effort": array(message.efforts, np.float64),
    }


def _joint_state_of(ros: Any, moment: Moment) -> JointState:
    arrays = (packed(numbers) for numbers in (ros.position, ros.velocity, ros.effort))
    return JointState(*stamp_and_frame(ros), tuple(ros.name), *arrays)


def _read_joint_state(ros: Any, now_nanos: int) -> JointState:
    """Return a command of joints, valid from `now_nanos`."""
    return joint_command(ros.name, (ros.position, ros.velocity, ros.effort), now_nanos)


def _nav_sat_fix(message: NavSatFix) -> dict[str, Any]:
    return {
        "header": header(message.stamp_nanos, message.frame),
        "status": TYPES["sensor_msgs/msg/NavSatStatus"](
            status=message.status, service=message.service
        ),
        "latitude": message.latitude_deg,
        "longitude": message.longitude_deg,
        "altitude": message.altitude_m,
        "position_covariance": array(message.position_covariance_m2, np.float64),
        "position_covariance_type": message.covariance_type,
    }


def _nav_sat_fix_of(ros: Any, moment: Moment) -> NavSatFix:
    return NavSatFix(
        *stamp_and_frame(ros),
        ros.status.status,
        ros.status.service,
        ros.latitude,
        ros.longitude,
        ros.altitude,
        packed(ros.position_covariance),
        ros.position_covariance_type,
    )


CODECS = (
    Codec(
        PoseStamped,
        "geometry_msgs/msg/PoseStamped",
        _pose_stamped,
        _pose_stamped_of,
        _read_pose_stamped,
    ),
    Codec(Odometry, "nav_msgs/msg/Odometry", _odometry, _odometry_of, _read_odometry),
    Codec(
        OccupancyGrid,
        "nav_msgs/msg/OccupancyGrid",
        _occupancy_grid,
        _occupancy_grid_of,
        _read_occupancy_grid,
    ),
    Codec(Transforms, "tf2_msgs/msg/TFMessage", _transforms, _transforms_of),
    Codec(
        JointState,
        "sensor_msgs/msg/JointState",
        _joint_state,
        _joint_state_of,
        _read_joint_state,
    ),
    Codec(Text, "std_msgs/msg/String", _text, _text_of),
    Codec(NavSatFix, "sensor_msgs/msg/NavSatFix", _nav_sat_fix, _nav_sat_fix_of),
)
