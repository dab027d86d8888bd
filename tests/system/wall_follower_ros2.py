# SPDX-License-Identifier: Apache-2.0
"""Wall follower as a ROS 2 node: ``python -m tests.system.wall_follower_ros2 LAPS``."""

import os
import sys
from typing import Any

from udp_bridge_ros2.environment import apply_defaults

apply_defaults(os.environ)

import rclpy  # noqa: E402
from geometry_msgs.msg import Twist  # noqa: E402
from nav_msgs.msg import Odometry  # noqa: E402
from sensor_msgs.msg import LaserScan  # noqa: E402

from .wall_following import Scan, WallFollower  # noqa: E402


def nanos(stamp: Any) -> int:
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def main(laps: int) -> None:
    rclpy.init()
    node = rclpy.create_node("wall_follower")
    follower = WallFollower(laps)
    publisher = node.create_publisher(Twist, "/cmd_vel", 10)

    def decide() -> None:
        for forward, turn in follower.decisions():
            twist = Twist()
            twist.linear.x, twist.angular.z = forward, turn
            publisher.publish(twist)

    def scan(message: Any) -> None:
        at = nanos(message.header.stamp), message.angle_min, message.angle_increment
        follower.scan(Scan(*at, list(message.ranges)))
        decide()

    def odometry(message: Any) -> None:
        turned = message.pose.pose.orientation
        follower.odometry(nanos(message.header.stamp), turned.z, turned.w)
        decide()

    node.create_subscription(LaserScan, "/scan", scan, 100)
    node.create_subscription(Odometry, "/odom", odometry, 100)
    rclpy.spin(node)


if __name__ == "__main__":
    main(int(sys.argv[1]))
