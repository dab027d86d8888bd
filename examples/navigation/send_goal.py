# SPDX-License-Identifier: Apache-2.0
"""Send a goal to the navigation node: `python send_goal.py X Y [YAW]`, in meters and radians."""

import math
import sys
import time

import rclpy
from geometry_msgs.msg import PoseStamped


def main(x: float, y: float, yaw: float = 0.0) -> None:
    """Publish /goal_pose once there is a subscriber."""
    rclpy.init()
    node = rclpy.create_node("send_goal")
    goals = node.create_publisher(PoseStamped, "/goal_pose", 10)
    while not goals.get_subscription_count():
        time.sleep(0.1)
    goal = PoseStamped()
    goal.header.frame_id = "map"
    goal.pose.position.x, goal.pose.position.y = x, y
    goal.pose.orientation.z, goal.pose.orientation.w = math.sin(yaw / 2), math.cos(yaw / 2)
    goals.publish(goal)
    goals.wait_for_all_acked()


if __name__ == "__main__":
    main(*map(float, sys.argv[1:]))
