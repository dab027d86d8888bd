# SPDX-License-Identifier: Apache-2.0
"""A ROS 1 user's node: prints each message as a JSON line [topic, stamp, content, frame].

Arguments: one JSON list of [type, topic, seconds that the callback sleeps at the first message with
a stamp]. Run by the Python that ROS 1 is installed for.
"""

import json
import sys
import time
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
        return {row.name: {pair.key: pair.value for pair in row.values} for row in message.status}
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

    naps: dict[str, float] = {}

    def take(message: Any, topic: str) -> None:
        frame = message.header.frame_id if hasattr(message, "header") else None
        line = json.dumps([topic, stamp_nanos(message), content(message), frame])
        sys.stdout.write(line + "\n")
        sys.stdout.flush()
        if stamp_nanos(message):
            time.sleep(naps.pop(topic, 0.0))

    for ros_type, topic, nap_s in json.loads(sys.argv[1]):
        naps[topic] = nap_s
        package, name = ros_type.split("/")
        message_class = getattr(import_module(f"{package}.msg"), name)
        rospy.Subscriber(topic, message_class, take, callback_args=topic, queue_size=10000)
    print("ready", flush=True)
    rospy.spin()


if __name__ == "__main__":
    main()
