# SPDX-License-Identifier: Apache-2.0
"""A publisher of its own process that publishes one message, latched, and stays.

Arguments: ros_type, topic, the message's CDR as hex.
"""

import signal
import sys
from importlib import import_module

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions


def main() -> None:
    ros_type, topic, body = sys.argv[1:]
    package, _, name = ros_type.split("/")
    message_class = getattr(import_module(f"{package}.msg"), name)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = rclpy.create_node("replayer")
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        publisher = node.create_publisher(message_class, topic, latched)
        message = deserialize_message(bytes.fromhex(body), message_class)
        publisher.publish(message)
        while True:
            rclpy.spin_once(node, timeout_sec=0.1)
            if name != "OccupancyGrid":  # what is not latched by everybody is said again
                publisher.publish(message)
    finally:
        rclpy.shutdown()


if __name__ == "__main__":
    main()
