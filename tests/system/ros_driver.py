# SPDX-License-Identifier: Apache-2.0
"""ROS 2 teleoperation node: publishes a Twist at 20 Hz for a given time.

Run as ``python -m tests.system.ros_driver LINEAR_MPS ANGULAR_RADPS SECONDS``.
"""

import os
import sys
import time

from udp_bridge_ros2.environment import apply_defaults

apply_defaults(os.environ)

import rclpy  # noqa: E402
from geometry_msgs.msg import Twist  # noqa: E402
from rclpy.node import Node  # noqa: E402


def main(linear_mps: float, angular_radps: float, seconds: float) -> None:
    rclpy.init()
    node = Node("driver")
    publisher = node.create_publisher(Twist, "/cmd_vel", 10)
    twist = Twist()
    twist.linear.x = linear_mps
    twist.angular.z = angular_radps
    while publisher.get_subscription_count() == 0:
        time.sleep(0.05)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        publisher.publish(twist)
        time.sleep(0.05)
    rclpy.shutdown()


if __name__ == "__main__":
    main(*map(float, sys.argv[1:]))
