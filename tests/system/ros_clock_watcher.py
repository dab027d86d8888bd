# SPDX-License-Identifier: Apache-2.0
"""ROS node with use_sim_time: a sim-time timer, and a callback for backward time jumps.

Run as ``python -m tests.system.ros_clock_watcher FILE``; it writes a JSON line for each event.
"""

import json
import os
import sys

from udp_bridge_ros2.environment import apply_defaults

apply_defaults(os.environ)

import rclpy  # noqa: E402
from rclpy.clock import JumpThreshold, TimeJump  # noqa: E402
from rclpy.duration import Duration  # noqa: E402
from rclpy.node import Node  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402

TIMER_NANOS = 50_000_000


def main(path: str) -> None:
    rclpy.init()
    node = Node("watcher", parameter_overrides=[Parameter("use_sim_time", value=True)])
    with open(path, "a", encoding="utf-8") as file:

        def tell(topic: str, **values: int) -> None:
            now = node.get_clock().now().nanoseconds
            file.write(json.dumps({"topic": topic, "now": now, **values}) + "\n")
            file.flush()

        def jumped(jump: TimeJump) -> None:
            tell("jump", delta=jump.delta.nanoseconds)

        threshold = JumpThreshold(
            min_forward=None, min_backward=Duration(nanoseconds=-1), on_clock_change=False
        )
        handle = node.get_clock().create_jump_callback(threshold, post_callback=jumped)
        node.create_timer(1e-9 * TIMER_NANOS, lambda: tell("timer"))
        with handle:
            rclpy.spin(node)


if __name__ == "__main__":
    main(sys.argv[1])
