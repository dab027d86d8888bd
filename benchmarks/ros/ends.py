# SPDX-License-Identifier: Apache-2.0
"""Sources and listeners of `benchmarks.ros`, each a process: ``python -m benchmarks.ros.ends END``.

A source reads the name of a message from standard input, publishes it and prints the start time. A
listener prints the time of its callback. Times are of the monotonic clock, in nanoseconds.
"""

import os
import random
import sys
import time
from collections.abc import Callable
from typing import Any

from groundlink.bus.topics import SENSOR_TOPICS
from groundlink.messages.base import POINT, BusMessage, Imu, PointCloud
from groundlink.ros.cdr import to_cdr

TOPICS = {"imu": "/imu", "cloud": "/points"}
PLAIN_TOPICS = {"imu": "/plain/imu", "cloud": "/plain/points"}
CLOUD_BYTES = 1_000_000
DEPTH = 10


def messages() -> dict[str, BusMessage]:
    """Return the messages to publish: an IMU sample and a cloud of 1 MB, stamped now."""
    count = CLOUD_BYTES // POINT.itemsize
    points = random.Random(1).randbytes(count * POINT.itemsize)
    unit = (0.0, 0.0, 0.0, 1.0)
    now = time.time_ns()
    return {
        "imu": Imu(now, "imu_link", unit, (0.1, 0.2, 0.3), (0.0, 0.0, 9.8), 0.0, 1e-6, 1e-4),
        "cloud": PointCloud(now, "lidar_link", memoryview(points)),
    }


def _node(name: str) -> tuple[Any, dict[str, Any]]:
    """Return a node with the bridge's DDS settings, and the message classes."""
    from udp_bridge_ros2 import environment

    environment.apply_defaults(os.environ)
    import rclpy
    from sensor_msgs.msg import Imu as RosImu
    from sensor_msgs.msg import PointCloud2

    rclpy.init()
    return rclpy.create_node(name), {"imu": RosImu, "cloud": PointCloud2}


def listener(which: str) -> None:
    """Print the times of callbacks; `which` is `ours` or `plain`."""
    import rclpy

    node, classes = _node(f"listener_{which}")
    topics = TOPICS if which == "ours" else PLAIN_TOPICS
    for name, topic in topics.items():
        node.create_subscription(classes[name], topic, _print_time, DEPTH)
    rclpy.spin(node)


def _print_time(_: Any) -> None:
    os.write(1, b"%d\n" % time.monotonic_ns())


def plain() -> None:
    """Publish messages from a ROS node; they are filled in advance."""
    from rclpy.serialization import deserialize_message

    node, classes = _node("source")
    filled = {
        name: deserialize_message(bytes(to_cdr(message)), classes[name])
        for name, message in messages().items()
    }
    publishers = {
        name: node.create_publisher(classes[name], topic, DEPTH)
        for name, topic in PLAIN_TOPICS.items()
    }
    for line in sys.stdin:
        name = line.strip()
        message = filled[name]
        message.header.stamp = node.get_clock().now().to_msg()
        began = time.monotonic_ns()
        publishers[name].publish(message)
        print(began, flush=True)


def sensor(endpoint: str, run: str, vehicle: str) -> None:
    """Publish messages on the bus, as a sensor does."""
    from msgspec.structs import replace

    from groundlink.bus.session import Bus

    filled = messages()
    with Bus(connect=endpoint) as bus:
        publish = {
            name: bus.publisher(row.key_in(run, vehicle=vehicle, sensor=name), row.delivery)
            for name, row in (("imu", SENSOR_TOPICS["imu"]), ("cloud", SENSOR_TOPICS["lidar"]))
        }
        for line in sys.stdin:
            name = line.strip()
            message = replace(filled[name], stamp_nanos=time.time_ns())
            began = time.monotonic_ns()
            publish[name](message)
            print(began, flush=True)


if __name__ == "__main__":
    ends: dict[str, Callable[..., None]] = {"listener": listener, "plain": plain, "sensor": sensor}
    ends[sys.argv[1]](*sys.argv[2:])
