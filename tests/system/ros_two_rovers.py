# SPDX-License-Identifier: Apache-2.0
"""ROS 2 node for two rovers: drives the second, and writes a JSON line for messages of both.

Run as ``python -m tests.system.ros_two_rovers FILE``.
"""

import json
import os
import sys

from udp_bridge_ros2.environment import apply_defaults

apply_defaults(os.environ)

import rclpy  # noqa: E402
from geometry_msgs.msg import Twist  # noqa: E402
from nav_msgs.msg import Odometry  # noqa: E402
from rclpy.node import Node  # noqa: E402
from rclpy.qos import DurabilityPolicy, QoSProfile  # noqa: E402
from sensor_msgs.msg import Imu, LaserScan  # noqa: E402
from tf2_msgs.msg import TFMessage  # noqa: E402

NAMESPACES = ("first", "second")
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def main(file: str) -> None:
    rclpy.init()
    node = Node("fleet")
    with open(file, "w", encoding="utf-8", buffering=1) as lines:

        def note(topic: str, **fields: object) -> None:
            lines.write(json.dumps({"topic": topic, **fields}) + "\n")

        def odometry(namespace: str, message: Odometry) -> None:
            at = message.pose.pose.position
            frames = [message.header.frame_id, message.child_frame_id]
            note(f"/{namespace}/odom", frames=frames, at=[at.x, at.y])

        def frames(topic: str, message: TFMessage) -> None:
            note(topic, frames={t.child_frame_id: t.header.frame_id for t in message.transforms})

        def stamped(topic: str, message: Imu | LaserScan) -> None:
            note(topic, frame=message.header.frame_id)

        for namespace in NAMESPACES:
            node.create_subscription(
                Odometry, f"/{namespace}/odom", lambda m, n=namespace: odometry(n, m), 100
            )
            for kind, name in ((Imu, "imu"), (LaserScan, "scan")):
                topic = f"/{namespace}/{name}"
                node.create_subscription(kind, topic, lambda m, t=topic: stamped(t, m), 10)
        node.create_subscription(TFMessage, "/tf", lambda m: frames("/tf", m), 100)
        node.create_subscription(
            TFMessage, "/tf_static", lambda m: frames("/tf_static", m), LATCHED
        )
        publisher = node.create_publisher(Twist, "/second/cmd_vel", 10)
        ahead = Twist()
        ahead.linear.x = 0.5
        node.create_timer(0.05, lambda: publisher.publish(ahead))
        try:
            rclpy.spin(node)
        except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
            pass


if __name__ == "__main__":
    main(sys.argv[1])
