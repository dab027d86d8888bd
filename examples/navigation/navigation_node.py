# SPDX-License-Identifier: Apache-2.0
"""Navigation as a ROS 2 node: drives to goals on a map, around obstacles that the map lacks.

    python navigation_node.py --ros-args -p map:=map.yaml -p initial_pose:="[0.0, 0.0, 0.0]"

Subscribes to /scan, /odom, /tf_static and /goal_pose. Answers each scan with a message on /cmd_vel.
Publishes /pose and the transform of `map` to `odom` for each scan, and /plan twice a second while
the robot has a goal.
"""

from pathlib import Path

import numpy as np
import rclpy
from builtin_interfaces.msg import Time
from controller import PurePursuit
from geometry_msgs.msg import PoseStamped, Quaternion, TransformStamped, Twist
from localization import Localizer
from nav_msgs.msg import Odometry
from nav_msgs.msg import Path as PathMessage
from occupancy_map import read_map
from planner import Planner
from poses import Floats, arc, compose, inverse, transformed
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import LaserScan
from tf2_msgs.msg import TFMessage

MAP, ODOM, BASE = "map", "odom", "base_link"
INSCRIBED_M, CIRCUMSCRIBED_M = 0.4, 0.65
"""Radii of a robot of 0.99 x 0.69 m, with 5 cm of margin."""

UNKNOWN_M = 0.3
"""A point of a scan so far from all obstacles of the map is one of an unknown obstacle."""

PLAN_EVERY_S = 0.5


class NavigationNode(Node):
    """Localizes, plans and steers in the callback of each scan."""

    def __init__(self) -> None:
        super().__init__("navigation")
        self.declare_parameter("map", "map.yaml")
        self.declare_parameter("initial_pose", [0.0, 0.0, 0.0])
        known = read_map(Path(self.get_parameter("map").value))
        self._localizer = Localizer(known, np.array(self.get_parameter("initial_pose").value))
        self._planner = Planner(known, INSCRIBED_M, CIRCUMSCRIBED_M)
        self._controller = PurePursuit()
        self._odometry: Odometry | None = None
        self._mounts: dict[str, Floats] = {}
        self._goal: Floats | None = None
        self._path: Floats | None = None
        self._planned_s = -np.inf
        latched = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._commands = self.create_publisher(Twist, "/cmd_vel", 10)
        self._poses = self.create_publisher(PoseStamped, "/pose", 10)
        self._plans = self.create_publisher(PathMessage, "/plan", 10)
        self._transforms = self.create_publisher(TFMessage, "/tf", 10)
        self.create_subscription(TFMessage, "/tf_static", self._on_mounts, latched)
        self.create_subscription(Odometry, "/odom", self._on_odometry, 10)
        self.create_subscription(PoseStamped, "/goal_pose", self._on_goal, 10)
        self.create_subscription(LaserScan, "/scan", self._on_scan, 10)
        rows, columns = known.free.shape
        self.get_logger().info(f"map of {columns} x {rows} cells; waiting for /goal_pose")

    def _on_mounts(self, message: TFMessage) -> None:
        for link in message.transforms:
            if link.header.frame_id == BASE:
                place, turn = link.transform.translation, link.transform.rotation
                self._mounts[link.child_frame_id] = np.array([place.x, place.y, yaw_of(turn)])

    def _on_odometry(self, message: Odometry) -> None:
        self._odometry = message

    def _on_goal(self, message: PoseStamped) -> None:
        place = message.pose.position
        self._goal = np.array([place.x, place.y, yaw_of(message.pose.orientation)])
        self._planned_s = -np.inf
        self.get_logger().info(f"driving to {place.x:.2f}, {place.y:.2f}")

    def _on_scan(self, scan: LaserScan) -> None:
        command = Twist()
        if self._odometry is not None and scan.header.frame_id in self._mounts:
            end_s = seconds_of(scan.header.stamp) + scan.time_increment * (len(scan.ranges) - 1)
            points = points_at_end(scan, self._mounts[scan.header.frame_id], self._odometry)
            odom_from_base = pose_at(self._odometry, end_s)
            pose = self._localizer.locate(points, odom_from_base)
            in_map = transformed(pose, points)
            self._planner.see(in_map[self._localizer.distances(in_map) > UNKNOWN_M], end_s)
            self._publish_pose(pose, compose(pose, inverse(odom_from_base)), end_s)
            if self._goal is not None:
                command.linear.x, command.angular.z = self._drive(pose, points, end_s).tolist()
        self._commands.publish(command)

    def _drive(self, pose: Floats, points: Floats, seconds: float) -> Floats:
        """Return the speed and the turn rate on the way to the goal."""
        if seconds >= self._planned_s + PLAN_EVERY_S:
            self._planned_s = seconds
            self._path = self._planner.plan(pose[:2], self._goal[:2], seconds)
            if self._path is None:
                self.get_logger().warning("no path to the goal", throttle_duration_sec=5.0)
            else:
                self._publish_plan(self._path, seconds)
        if self._path is None:
            return np.zeros(2)
        command = self._controller.command(pose, self._path, self._goal[2], points)
        if command is None:
            self.get_logger().info(f"arrived at {pose[0]:.2f}, {pose[1]:.2f}")
            self._goal = self._path = None
            return np.zeros(2)
        return command

    def _publish_pose(self, map_from_base: Floats, map_from_odom: Floats, seconds: float) -> None:
        self._poses.publish(pose_message(map_from_base, seconds))
        link = TransformStamped(child_frame_id=ODOM)
        link.header.frame_id, link.header.stamp = MAP, stamp_of(seconds)
        link.transform.translation.x, link.transform.translation.y = map_from_odom[:2].tolist()
        link.transform.rotation = quaternion(map_from_odom[2])
        self._transforms.publish(TFMessage(transforms=[link]))

    def _publish_plan(self, path: Floats, seconds: float) -> None:
        message = PathMessage()
        message.header.frame_id, message.header.stamp = MAP, stamp_of(seconds)
        message.poses = [pose_message(np.append(point, 0.0), seconds) for point in path]
        self._plans.publish(message)


def points_at_end(scan: LaserScan, mount: Floats, odometry: Odometry) -> Floats:
    """Return the points of a scan in the base frame at the scan's end, shape (N, 2).

    The robot's velocity during the scan is that of the odometry message.
    """
    ranges = np.array(scan.ranges)
    rays = np.flatnonzero((ranges >= scan.range_min) & (ranges <= scan.range_max))
    angles = scan.angle_min + rays * scan.angle_increment
    at_ray = np.column_stack([np.cos(angles), np.sin(angles)]) * ranges[rays, None]
    twist = odometry.twist.twist
    before_s = scan.time_increment * (rays - (len(ranges) - 1))
    moved = arc(twist.linear.x, twist.angular.z, before_s)
    in_base = transformed(mount, at_ray)
    points = compose(moved, np.column_stack([in_base, np.zeros(len(in_base))]))[:, :2]
    return points[np.hypot(*in_base.T) > CIRCUMSCRIBED_M]  # without the robot itself


def pose_at(odometry: Odometry, seconds: float) -> Floats:
    """Return odom_from_base at a time near that of an odometry message."""
    place, turn = odometry.pose.pose.position, odometry.pose.pose.orientation
    twist = odometry.twist.twist
    after_s = np.array([seconds - seconds_of(odometry.header.stamp)])
    moved = arc(twist.linear.x, twist.angular.z, after_s)[0]
    return compose(np.array([place.x, place.y, yaw_of(turn)]), moved)


def pose_message(pose: Floats, seconds: float) -> PoseStamped:
    """Return a pose in the map as a message."""
    message = PoseStamped()
    message.header.frame_id, message.header.stamp = MAP, stamp_of(seconds)
    message.pose.position.x, message.pose.position.y = pose[:2].tolist()
    message.pose.orientation = quaternion(pose[2])
    return message


def quaternion(yaw: float) -> Quaternion:
    """Return a rotation about z."""
    return Quaternion(z=float(np.sin(yaw / 2)), w=float(np.cos(yaw / 2)))


def yaw_of(q: Quaternion) -> float:
    """Return the rotation about z."""
    return float(np.arctan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z)))


def seconds_of(stamp: Time) -> float:
    """Return a stamp in seconds."""
    return float(stamp.sec + 1e-9 * stamp.nanosec)


def stamp_of(seconds: float) -> Time:
    """Return seconds as a stamp."""
    nanos = round(seconds * 1e9)
    return Time(sec=nanos // 1_000_000_000, nanosec=nanos % 1_000_000_000)


def main() -> None:
    """Run the node until Ctrl-C."""
    rclpy.init()
    try:
        rclpy.spin(NavigationNode())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == "__main__":
    main()
