# SPDX-License-Identifier: Apache-2.0
"""ROS 2 node that subscribes to cameras and writes a JSON line for each message.

Run as ``python -m tests.system.ros_pictures FILE``. It depends on Groundlink's topics only.
"""

import hashlib
import json
import os
import sys
import time

from udp_bridge_ros2.environment import apply_defaults

apply_defaults(os.environ)

import cv2  # noqa: E402
import numpy as np  # noqa: E402
import rclpy  # noqa: E402
from rclpy.node import Node  # noqa: E402
from rclpy.qos import QoSProfile, ReliabilityPolicy  # noqa: E402
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2  # noqa: E402

BEST_EFFORT = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)

TOPICS = {
    "/camera/image_raw/compressed": CompressedImage,
    "/camera/camera_info": CameraInfo,
    "/depth/image_rect_raw": Image,
    "/depth/image_rect_raw/compressedDepth": CompressedImage,
    "/depth/camera_info": CameraInfo,
    "/depth/points": PointCloud2,
    "/stereo/left/image_raw": Image,
    "/stereo/left/camera_info": CameraInfo,
    "/stereo/right/image_raw": Image,
    "/stereo/right/camera_info": CameraInfo,
}

DEPTH_HEADER_BYTES = 12


def decoded(message: CompressedImage) -> str:
    """Return the digest of what OpenCV makes of a compressed image."""
    begin = DEPTH_HEADER_BYTES if "compressedDepth" in message.format else 0
    file = np.frombuffer(bytes(message.data), np.uint8)[begin:]
    pixels = cv2.imdecode(file, cv2.IMREAD_UNCHANGED)
    return hashlib.sha256(pixels.tobytes()).hexdigest()


def described(message: object) -> dict[str, object]:
    header = message.header  # type: ignore[attr-defined]
    told: dict[str, object] = {
        "stamp": header.stamp.sec * 10**9 + header.stamp.nanosec,
        "frame": header.frame_id,
    }
    if isinstance(message, CameraInfo):
        return told | {"p": list(message.p)}
    told["data"] = hashlib.sha256(bytes(message.data)).hexdigest()  # type: ignore[attr-defined]
    if isinstance(message, CompressedImage):
        told |= {"format": message.format, "decoded": decoded(message)}
    return told


def main(file: str) -> None:
    rclpy.init()
    node = Node("pictures")
    with open(file, "w", encoding="utf-8", buffering=1) as lines:

        def note(topic: str, message: object) -> None:
            line = {"topic": topic, "seen": time.monotonic(), **described(message)}
            lines.write(json.dumps(line) + "\n")

        for topic, message_type in TOPICS.items():
            node.create_subscription(
                message_type, topic, lambda m, topic=topic: note(topic, m), BEST_EFFORT
            )
        try:
            rclpy.spin(node)
        except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
            pass


if __name__ == "__main__":
    main(sys.argv[1])
