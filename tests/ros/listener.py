# SPDX-License-Identifier: Apache-2.0
"""A subscriber of its own process: prints each message as JSON: [topic, stamp, content, frame].

Arguments: one JSON list of [ros_type, topic, reliability, durability, depth, sleep_s]. Who sleeps
does so at the first message with a stamp, and prints on "TOPIC numbers" those of its publisher.
"""

import json
import signal
import sys
import time
import zlib
from collections.abc import Callable
from importlib import import_module
from typing import Any

import rclpy
from cloud_digest import cloud_digest
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rclpy.signals import SignalHandlerOptions

CONTENT: dict[str, Callable[[Any], Any]] = {
    "PointCloud2": lambda message: [
        zlib.crc32(message.data),
        message.header.frame_id,
        cloud_digest(message),
    ],
    "Imu": lambda message: message.linear_acceleration.x,
    "WheelEncoders": lambda message: [list(message.name), list(message.ticks)],
    "Clock": lambda message: None,
    "DiagnosticArray": lambda message: [
        [row.name, [row.level[0], row.hardware_id, {pair.key: pair.value for pair in row.values}]]
        for row in message.status
    ],
    "TFMessage": lambda message: {
        row.child_frame_id: row.transform.translation.x for row in message.transforms
    },
}


def as_cdr(message: Any) -> str:
    return serialize_message(message).hex()


def stamp_nanos(message: Any) -> int:
    if hasattr(message, "transforms"):
        message = message.transforms[-1]
    if hasattr(message, "data") and isinstance(message.data, str):
        return 0  # a text has none
    stamp = message.clock if hasattr(message, "clock") else message.header.stamp
    return int(stamp.sec * 1_000_000_000 + stamp.nanosec)


def subscribe(
    node: Any,
    ros_type: str,
    topic: str,
    reliability: str,
    durability: str,
    depth: int,
    sleep_s: float,
) -> None:
    package, _, name = ros_type.split("/")

    naps = [sleep_s] if sleep_s else []

    def take(message: Any, info: Any) -> None:
        content = CONTENT.get(name, as_cdr)(message)
        frame = message.header.frame_id if hasattr(message, "header") else None
        print(json.dumps([topic, stamp_nanos(message), content, frame]), flush=True)
        if sleep_s:
            print(json.dumps([f"{topic} numbers", info["publication_sequence_number"], None]))
        if stamp_nanos(message) and naps:
            time.sleep(naps.pop())

    qos = QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy[reliability],
        durability=DurabilityPolicy[durability],
    )
    node.create_subscription(getattr(import_module(f"{package}.msg"), name), topic, take, qos)


def main() -> None:
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())  # also out of a callback that sleeps
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = rclpy.create_node("listener")
        for row in json.loads(sys.argv[1]):
            subscribe(node, *row)
        print(json.dumps(["ready", 0, None]), flush=True)
        while True:
            rclpy.spin_once(node, timeout_sec=0.1)
    finally:
        rclpy.shutdown()


if __name__ == "__main__":
    main()
