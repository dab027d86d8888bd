# SPDX-License-Identifier: Apache-2.0
"""ROS 2 node that subscribes to a rover's topics and writes a JSON line for each message.

Run as ``python -m tests.system.ros_observer FILE``. It depends on Groundlink's topics only.
"""

import json
import os
import sys
import time

from udp_bridge_ros2.environment import apply_defaults

apply_defaults(os.environ)

import rclpy  # noqa: E402
from groundlink_msgs.msg import WheelEncoders  # noqa: E402
from rclpy.node import Node  # noqa: E402
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402
from sensor_msgs.msg import (  # noqa: E402
    CameraInfo,
    CompressedImage,
    Imu,
    JointState,
    LaserScan,
    PointCloud2,
)
from tf2_msgs.msg import TFMessage  # noqa: E402

BEST_EFFORT = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def nanos(stamp: object) -> int:
    return stamp.sec * 10**9 + stamp.nanosec  # type: ignore[attr-defined, no-any-return]


def cloud(message: PointCloud2) -> dict[str, object]:
    return {
        "stamp": nanos(message.header.stamp),
        "frame": message.header.frame_id,
        "width": message.width,
        "point_step": message.point_step,
        "fields": [field.name for field in message.fields],
        "dense": message.is_dense,
        "data": len(message.data),
    }


def header(message: CompressedImage | CameraInfo) -> dict[str, object]:
    return {"stamp": nanos(message.header.stamp), "frame": message.header.frame_id}


def scan(message: LaserScan) -> dict[str, object]:
    return {
        "stamp": nanos(message.header.stamp),
        "frame": message.header.frame_id,
        "angles": [message.angle_min, message.angle_increment, message.angle_max],
        "times": [message.time_increment, message.scan_time],
        "limits": [message.range_min, message.range_max],
        "ranges": list(message.ranges),
        "intensities": len(message.intensities),
    }


def imu(message: Imu) -> dict[str, object]:
    g = message.linear_acceleration
    return {
        "stamp": nanos(message.header.stamp),
        "frame": message.header.frame_id,
        "acceleration": [g.x, g.y, g.z],
    }


def encoders(message: WheelEncoders) -> dict[str, object]:
    return {
        "stamp": nanos(message.header.stamp),
        "name": list(message.name),
        "ticks": list(message.ticks),
    }


def joints(message: JointState) -> dict[str, object]:
    return {
        "stamp": nanos(message.header.stamp),
        "name": list(message.name),
        "position": list(message.position),
        "velocity": list(message.velocity),
        "effort": list(message.effort),
    }


def clock(message: Clock) -> dict[str, object]:
    return {"stamp": nanos(message.clock)}


def transforms(message: TFMessage) -> dict[str, object]:
    return {"frames": {t.child_frame_id: t.header.frame_id for t in message.transforms}}


TOPICS = (
    ("/points", PointCloud2, cloud, BEST_EFFORT),
    ("/points/truth", PointCloud2, cloud, BEST_EFFORT),
    ("/scan", LaserScan, scan, BEST_EFFORT),
    ("/scan_cheap", LaserScan, scan, BEST_EFFORT),
    ("/camera/image_raw/compressed", CompressedImage, header, BEST_EFFORT),
    ("/camera/camera_info", CameraInfo, header, BEST_EFFORT),
    ("/imu", Imu, imu, BEST_EFFORT),
    ("/wheel_encoders", WheelEncoders, encoders, BEST_EFFORT),
    ("/clock", Clock, clock, BEST_EFFORT),
    ("/ground_truth/wheels", JointState, joints, BEST_EFFORT),
    ("/ground_truth/bodies", TFMessage, transforms, BEST_EFFORT),
    ("/tf_static", TFMessage, transforms, LATCHED),
)


def main(file: str) -> None:
    rclpy.init()
    node = Node("observer")
    with open(file, "w", encoding="utf-8", buffering=1) as lines:

        def note(topic: str, fields: dict[str, object]) -> None:
            lines.write(json.dumps({"topic": topic, "seen": time.monotonic(), **fields}) + "\n")

        for topic, message_type, describe, qos in TOPICS:
            node.create_subscription(
                message_type,
                topic,
                lambda message, topic=topic, describe=describe: note(topic, describe(message)),
                qos,
            )
        try:
            rclpy.spin(node)
        except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
            pass


if __name__ == "__main__":
    main(sys.argv[1])
