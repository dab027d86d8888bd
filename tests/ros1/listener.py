# SPDX-License-Identifier: Apache-2.0
"""A ROS 1 user's node: prints each message as a JSON line [topic, stamp, content].

Arguments: one JSON list of [type, topic]. Run by the Python that ROS 1 is installed for.
"""

from __future__ import annotations

import json
import sys
from importlib import import_module
from typing import Any

import rospy
from cloud_digest import cloud_digest


def content(message: Any) -> Any:
    if hasattr(message, "transforms"):
        return {row.child_frame_id: row.header.frame_id for row in message.transforms}
    if hasattr(message, "ticks"):
        return [message.header.frame_id, list(message.name), list(message.ticks)]
    if isinstance(getattr(message, "status", None), list):
        return [row.name for row in message.status]
    if hasattr(message, "point_step"):
        size = message.width * message.height * message.point_step
        return [message.header.frame_id, len(message.data) == size > 0, cloud_digest(message)]
    return [message.header.frame_id] if hasattr(message, "header") else None


def stamp_nanos(message: Any) -> int:
    if hasattr(message, "transforms"):
        message = message.transforms[-1]
    if not hasattr(message, "header") and not hasattr(message, "clock"):
        return 0  # a text
    stamp = message.clock if hasattr(message, "clock") else message.header.stamp
    return int(stamp.to_nsec())


def main() -> None:
    rospy.init_node("listener", anonymous=True)

    def take(message: Any, topic: str) -> None:
        line = json.dumps([topic, stamp_nanos(message), content(message)])
        sys.stdout.write(line + "\n")
        sys.stdout.flush()

    for ros_type, topic in json.loads(sys.argv[1]):
        package, name = ros_type.split("/")
        message_class = getattr(import_module(f"{package}.msg"), name)
        rospy.Subscriber(topic, message_class, take, callback_args=topic, queue_size=10000)
    print("ready", flush=True)
    rospy.spin()


if __name__ == "__main__":
    main()
