# SPDX-License-Identifier: Apache-2.0
"""ROS 2 controller in the loop, as a user would write it: follows a wavy line by feedback.

Run as ``python -m tests.system.ros_controller WAY LONGEST_DELAY_S``. WAY is one of:

- `odom`: answers each message on /odom with a message on /cmd_vel;
- `timer`: a sim-time timer sends a message on /cmd_vel every 20 ms, from the newest odometry;
- `joints`: answers each message on /clock with a message on /joint_commands, and prints the
  corresponding /joint_states.

Delays are random, in wall-clock time, and differ from run to run.
"""

import math
import os
import random
import sys
import time

from udp_bridge_ros2.environment import apply_defaults

apply_defaults(os.environ)

import rclpy  # noqa: E402
from builtin_interfaces.msg import Time  # noqa: E402
from geometry_msgs.msg import Twist  # noqa: E402
from nav_msgs.msg import Odometry  # noqa: E402
from rclpy.node import Node  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402


def delay(longest_s: float) -> None:
    """Wait now and then."""
    if longest_s and random.random() < 0.2:
        time.sleep(random.uniform(0.0, longest_s))


class Controller(Node):  # type: ignore[misc]
    """Steers to and fro by its position and its heading."""

    def __init__(self, way: str, longest_delay_s: float) -> None:
        use_sim_time = Parameter("use_sim_time", value=way == "timer")
        super().__init__("controller", parameter_overrides=[use_sim_time])
        self._longest_delay_s = longest_delay_s
        self._odometry = Odometry()
        self._publisher = self.create_publisher(Twist, "/cmd_vel", 10)
        self.create_subscription(Odometry, "/odom", self._take, 10)
        self._answers = way == "odom"
        if way == "timer":
            self.create_timer(0.02, self._steer)

    def _take(self, odometry: Odometry) -> None:
        self._odometry = odometry
        if self._answers:
            self._steer()

    def _steer(self) -> None:
        delay(self._longest_delay_s)
        pose = self._odometry.pose.pose
        yaw = 2 * math.atan2(pose.orientation.z, pose.orientation.w)
        stamp = self._odometry.header.stamp
        now = stamp.sec + 1e-9 * stamp.nanosec
        twist = Twist()
        twist.linear.x = 0.6 + 0.2 * math.sin(3 * pose.position.x)
        wanted = 0.5 * math.sin(0.9 * now + pose.position.x)
        twist.angular.z = 1.5 * (wanted - yaw) - 0.8 * pose.position.y
        self._publisher.publish(twist)


class Gunner(Node):  # type: ignore[misc]
    """Turns a turret to and fro, raises the gun as far as it has turned, and drives the tracks.

    Values have no gaps, as `topic_based_ros2_control` publishes joints of several kinds.
    """

    def __init__(self, longest_delay_s: float) -> None:
        super().__init__("gunner")
        self._longest_delay_s = longest_delay_s
        self._publisher = self.create_publisher(JointState, "/joint_commands", 10)
        self.create_subscription(Clock, "/clock", self._aim, 10)
        self.create_subscription(JointState, "/joint_states", self._take, 10)

    def _aim(self, clock: Clock) -> None:
        if clock.clock == Time():
            return  # the first clock of a run needs no answer
        delay(self._longest_delay_s)
        turret = math.sin(clock.clock.sec + 1e-9 * clock.clock.nanosec)
        names = ["left_track", "right_track", "gun", "turret"]
        position = [0.2 * turret, turret]
        self._publisher.publish(JointState(name=names, velocity=[4.0, 4.0], position=position))

    def _take(self, joints: JointState) -> None:
        stamp = joints.header.stamp.sec + 1e-9 * joints.header.stamp.nanosec
        print(f"{stamp:.3f}", *joints.name, *joints.position)


def main(way: str, longest_delay_s: float) -> None:
    rclpy.init()
    node = Gunner(longest_delay_s) if way == "joints" else Controller(way, longest_delay_s)
    rclpy.spin(node)


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]))
