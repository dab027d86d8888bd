# SPDX-License-Identifier: Apache-2.0
"""ROS 2 node in its own container: prints its received messages as JSON, four times a second.

It depends only on names and types of topics. Messages are received as bytes, and only the stamp,
the first field of every header, is decoded.
"""

import json
import struct
import time

import rclpy
from groundlink_msgs.msg import WheelEncoders
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, CompressedImage, Imu, PointCloud2

TOPICS = {
    "/clock": Clock,
    "/points": PointCloud2,
    "/imu": Imu,
    "/wheel_encoders": WheelEncoders,
    "/camera/image_raw/compressed": CompressedImage,
    "/camera/camera_info": CameraInfo,
}
QOS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
STAMP = struct.Struct("<iI")
PERIOD_S = 0.25


def main() -> None:
    rclpy.init()
    node = Node("observer")
    seen: dict[str, tuple[int, int]] = {}

    def count(topic: str, message: bytes) -> None:
        seconds, nanos = STAMP.unpack_from(message, 4)
        seen[topic] = (seen.get(topic, (0, 0))[0] + 1, seconds * 10**9 + nanos)

    for topic, kind in TOPICS.items():
        node.create_subscription(
            kind, topic, lambda message, topic=topic: count(topic, message), QOS, raw=True
        )
    due = time.monotonic()
    while True:
        rclpy.spin_once(node, timeout_sec=0.05)
        if time.monotonic() >= due:
            due += PERIOD_S
            print(json.dumps({"time": time.time(), "seen": seen}), flush=True)


if __name__ == "__main__":
    main()
