# SPDX-License-Identifier: Apache-2.0
"""How poses, maps and the like fill their ROS messages.

Rule: one function a message, from the message to the fields of its ROS type; `ros_messages` has the
table that names them. What comes back from ROS is read in `ros_incoming`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from groundlink.messages.navigation import (
    JointState,
    NavSatFix,
    OccupancyGrid,
    Odometry,
    PoseStamped,
    Text,
    Transforms,
)

from .types import TYPES, array, header, pose, quaternion, time, vector


def pose_stamped(message: PoseStamped) -> dict[str, Any]:
    """Return the fields of geometry_msgs/PoseStamped."""
    return {
        "header": header(message.stamp_nanos, message.frame),
        "pose": pose(message.position_m, message.orientation),
    }


def odometry(message: Odometry) -> dict[str, Any]:
    """Return the fields of nav_msgs/Odometry."""
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


def occupancy_grid(message: OccupancyGrid) -> dict[str, Any]:
    """Return the fields of nav_msgs/OccupancyGrid."""
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


def transforms(message: Transforms) -> dict[str, Any]:
    """Return the fields of tf2_msgs/TFMessage."""
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


def text(message: Text) -> dict[str, Any]:
    """Return the fields of std_msgs/String."""
    return {"data": message.text}


def joint_state(message: JointState) -> dict[str, Any]:
    """Return the fields of sensor_msgs/JointState."""
    return {
        "header": header(message.stamp_nanos, message.frame),
        "name": list(message.names),
        "position": array(message.positions, np.float64),
        "velocity": array(message.velocities, np.float64),
        "effort": array(message.efforts, np.float64),
    }


def nav_sat_fix(message: NavSatFix) -> dict[str, Any]:
    """Return the fields of sensor_msgs/NavSatFix."""
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
