# SPDX-License-Identifier: Apache-2.0
"""Five ROS 2 nodes of a stack: `python -m benchmarks.ros_graph.nodes NODES THREADS DELAY_S`.

NODES are names from `NODES`, joined by commas; they share a process and an executor with some
threads. Delays are random up to DELAY_S, in wall-clock time, and differ from run to run. `timer` is
a planner that breaks the rule: it also publishes by the wall clock.
"""

import math
import os
import random
import sys
import time
from typing import Any

from udp_bridge_ros2.environment import apply_defaults

from .runs import TIMED, TIMED_TARGETS

apply_defaults(os.environ)

import rclpy  # noqa: E402
from geometry_msgs.msg import PointStamped, PoseStamped, Twist  # noqa: E402
from nav_msgs.msg import Odometry  # noqa: E402
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor  # noqa: E402
from rclpy.node import Node  # noqa: E402
from sensor_msgs.msg import Imu, LaserScan  # noqa: E402
from std_msgs.msg import String  # noqa: E402


class SlowNode(Node):
    """A node that delays one answer in five at random."""

    def __init__(self, name: str, longest_delay_s: float) -> None:
        super().__init__(name)
        self._longest_delay_s = longest_delay_s

    def think(self) -> None:
        """Sleep as long as the answer is delayed."""
        if self._longest_delay_s and random.random() < 0.2:
            time.sleep(random.uniform(0.0, self._longest_delay_s))


class OdometryEstimator(SlowNode):
    """Joins odometry and IMU of one stamp, in whichever order they come."""

    def __init__(self, name: str, longest_delay_s: float) -> None:
        super().__init__(name, longest_delay_s)
        self._waiting: dict[tuple[int, int], Any] = {}
        self._publisher = self.create_publisher(Odometry, "/estimate", 10)
        self.create_subscription(Odometry, "/odom", self._take, 10)
        self.create_subscription(Imu, "/imu", self._take, 10)

    def _take(self, message: Odometry | Imu) -> None:
        self.think()
        key = message.header.stamp.sec, message.header.stamp.nanosec
        other = self._waiting.pop(key, None)
        if other is None:
            self._waiting[key] = message
            return
        odometry, imu = (message, other) if isinstance(message, Odometry) else (other, message)
        odometry.twist.twist.angular.z = imu.angular_velocity.z
        self._publisher.publish(odometry)


class ObstacleDetector(SlowNode):
    """Finds the nearest obstacle in a scan."""

    def __init__(self, name: str, longest_delay_s: float) -> None:
        super().__init__(name, longest_delay_s)
        self._publisher = self.create_publisher(PointStamped, "/obstacle", 10)
        self.create_subscription(LaserScan, "/scan", self._take, 10)

    def _take(self, scan: LaserScan) -> None:
        self.think()
        found = PointStamped(header=scan.header)
        found.point.x, index = min((r, i) for i, r in enumerate(scan.ranges) if math.isfinite(r))
        found.point.y = scan.angle_min + index * scan.angle_increment
        self._publisher.publish(found)


class ObstaclePlanner(SlowNode):
    """Turns away from the nearest obstacle; answers estimates as well as obstacles."""

    def __init__(self, name: str, longest_delay_s: float) -> None:
        super().__init__(name, longest_delay_s)
        self._obstacle = PointStamped()
        self._publisher = self.create_publisher(PoseStamped, "/target", 10)
        self.create_subscription(Odometry, "/estimate", self._take_estimate, 10)
        self.create_subscription(PointStamped, "/obstacle", self._take_obstacle, 10)

    def _take_obstacle(self, obstacle: PointStamped) -> None:
        self._obstacle = obstacle
        self._plan(obstacle.header, 0.1)

    def _take_estimate(self, estimate: Odometry) -> None:
        self._plan(estimate.header, estimate.twist.twist.angular.z)

    def _plan(self, header: Any, rate: float) -> None:
        self.think()
        target = PoseStamped(header=header)
        target.pose.position.x = 0.6 + 0.1 * self._obstacle.point.x
        target.pose.position.y = 0.3 * math.sin(self._obstacle.point.y) - 0.5 * rate
        self._publisher.publish(target)


class WallClockPlanner(ObstaclePlanner):
    """Publishes by the wall clock, too, and thereby breaks the rule."""

    def __init__(self, name: str, longest_delay_s: float) -> None:
        super().__init__(name, longest_delay_s)
        header = PoseStamped().header
        self.create_timer(0.05, lambda: self._plan(header, time.monotonic() % 1.0))


class TargetController(SlowNode):
    """Answers each target with a command, and logs when it got some of them."""

    def __init__(self, name: str, longest_delay_s: float) -> None:
        super().__init__(name, longest_delay_s)
        self._number = 0
        self._publisher = self.create_publisher(Twist, "/cmd_vel", 10)
        self.create_subscription(PoseStamped, "/target", self._take, 10)

    def _take(self, target: PoseStamped) -> None:
        self.think()
        self._number += 1
        if self._number in TIMED_TARGETS:
            print(f"{TIMED} {time.monotonic()}", flush=True)
        twist = Twist()
        twist.linear.x = target.pose.position.x
        twist.angular.z = target.pose.position.y + 0.1 * math.sin(self._number / 30)
        self._publisher.publish(twist)


class SpeedWatchdog(SlowNode):
    """Answers every fifth command with a status."""

    def __init__(self, name: str, longest_delay_s: float) -> None:
        super().__init__(name, longest_delay_s)
        self._speeds: list[float] = []
        self._publisher = self.create_publisher(String, "/status", 10)
        self.create_subscription(Twist, "/cmd_vel", self._take, 10)

    def _take(self, twist: Twist) -> None:
        self._speeds.append(twist.linear.x)
        if len(self._speeds) == 5:
            self.think()
            self._publisher.publish(String(data=str(sum(self._speeds))))
            self._speeds.clear()


NODES = {
    "estimator": OdometryEstimator,
    "detector": ObstacleDetector,
    "planner": ObstaclePlanner,
    "timer": WallClockPlanner,
    "controller": TargetController,
    "watchdog": SpeedWatchdog,
}


def main(names: str, threads: int, longest_delay_s: float) -> None:
    """Run nodes until a signal."""
    rclpy.init()
    executor = MultiThreadedExecutor(threads) if threads > 1 else SingleThreadedExecutor()
    for name in names.split(","):
        executor.add_node(NODES[name](name, longest_delay_s))
    executor.spin()


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), float(sys.argv[3]))
