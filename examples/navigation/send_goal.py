# SPDX-License-Identifier: Apache-2.0
"""Send a goal to the navigation node: `python send_goal.py X Y [YAW]`, in meters and radians.

Ends when the poses on /pose stand still at the goal.
"""

import math
import sys
import time

import rclpy
from geometry_msgs.msg import PoseStamped

THERE_M = 0.1
STANDS_M = 0.002
"""Largest motion from one pose to the next."""


def main(x: float, y: float, yaw: float = 0.0) -> None:
    """Publish /goal_pose once there is a subscriber; wait for the robot."""
    rclpy.init()
    node = rclpy.create_node("send_goal")
    places: list[tuple[float, float]] = []

    def follow(pose: PoseStamped) -> None:
        places.append((pose.pose.position.x, pose.pose.position.y))

    def is_there() -> bool:
        before, now = places[-2:] if len(places) > 1 else ((math.inf, 0.0), (0.0, 0.0))
        return math.dist(before, now) < STANDS_M and math.dist(now, (x, y)) < THERE_M

    node.create_subscription(PoseStamped, "/pose", follow, 10)
    goals = node.create_publisher(PoseStamped, "/goal_pose", 10)
    while not goals.get_subscription_count():
        time.sleep(0.1)
    goal = PoseStamped()
    goal.header.frame_id = "map"
    goal.pose.position.x, goal.pose.position.y = x, y
    goal.pose.orientation.z, goal.pose.orientation.w = math.sin(yaw / 2), math.cos(yaw / 2)
    goals.publish(goal)
    while not is_there():
        rclpy.spin_once(node)
    print(f"arrived at {places[-1][0]:.2f}, {places[-1][1]:.2f}")


if __name__ == "__main__":
    try:
        main(*map(float, sys.argv[1:]))
    except KeyboardInterrupt:
        pass
