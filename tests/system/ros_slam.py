# SPDX-License-Identifier: Apache-2.0
"""Minimal stand-in for a ROS 2 SLAM node: a map, and a pose and a plan for each cloud.

Run as ``python -m tests.system.ros_slam``. The pose is constant, so map and ground truth diverge as
the vehicle drives.
"""

import os

from udp_bridge_ros2.environment import apply_defaults

apply_defaults(os.environ)

import rclpy  # noqa: E402
from geometry_msgs.msg import PoseStamped  # noqa: E402
from nav_msgs.msg import OccupancyGrid, Path  # noqa: E402
from rclpy.node import Node  # noqa: E402
from rclpy.qos import DurabilityPolicy, QoSProfile  # noqa: E402
from sensor_msgs.msg import PointCloud2  # noqa: E402

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
CELLS, CELL_M = 120, 0.05


def the_map() -> OccupancyGrid:
    grid = OccupancyGrid()
    grid.header.frame_id = "map"
    grid.info.resolution, grid.info.width, grid.info.height = CELL_M, CELLS, CELLS
    grid.info.origin.position.x = grid.info.origin.position.y = -CELLS * CELL_M / 2
    grid.info.origin.orientation.w = 1.0
    grid.data = [100 if row % 20 < 10 else 0 for row in range(CELLS) for _ in range(CELLS)]
    return grid


def main() -> None:
    rclpy.init()
    node = Node("slam")
    maps = node.create_publisher(OccupancyGrid, "/map", LATCHED)
    poses = node.create_publisher(PoseStamped, "/pose", 10)
    plans = node.create_publisher(Path, "/plan", 10)
    maps.publish(the_map())

    def localize(cloud: PointCloud2) -> None:
        pose = PoseStamped()
        pose.header.stamp, pose.header.frame_id = cloud.header.stamp, "map"
        pose.pose.orientation.w = 1.0
        poses.publish(pose)
        goal = PoseStamped()
        goal.header, goal.pose.position.x, goal.pose.orientation.w = pose.header, 2.0, 1.0
        plans.publish(Path(header=pose.header, poses=[pose, goal]))

    node.create_subscription(PointCloud2, "/points", localize, 10)
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
        pass


if __name__ == "__main__":
    main()
