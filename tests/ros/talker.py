# SPDX-License-Identifier: Apache-2.0
"""A publisher of its own process: numbered messages, and a JSON line when its readers change.

Arguments: ros_type, topic, rate in Hz. The number is Twist's linear.x or the pose's position.x.
"""

import json
import signal
import sys
import time
from importlib import import_module
from typing import Any

import rclpy
from rclpy.signals import SignalHandlerOptions


def numbered(message: Any, number: int) -> Any:
    if hasattr(message, "linear"):
        message.linear.x = float(number)
    else:
        message.header.stamp.sec, message.header.frame_id = number, "map"
        message.pose.position.x = float(number)
    return message


def talk(node: Any, message_class: Any, topic: str, rate_hz: float) -> None:
    publisher = node.create_publisher(message_class, topic, 10)
    readers, number = -1, 0
    while True:
        if publisher.get_subscription_count() != readers:
            readers = publisher.get_subscription_count()
            print(json.dumps(["readers", number, readers]), flush=True)
        number += 1
        publisher.publish(numbered(message_class(), number))
        time.sleep(1 / rate_hz)


def main() -> None:
    ros_type, topic, rate = sys.argv[1:]
    package, _, name = ros_type.split("/")
    message_class = getattr(import_module(f"{package}.msg"), name)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        talk(rclpy.create_node("talker"), message_class, topic, float(rate))
    finally:
        rclpy.shutdown()


if __name__ == "__main__":
    main()
