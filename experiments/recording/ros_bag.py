# SPDX-License-Identifier: Apache-2.0
"""A ROS 2 node that records the topics of the bridge.

Command: `python -m experiments.recording.ros_bag OUT SECONDS`.

The node knows only the name of the bridge. It subscribes to all of the bridge's topics as
`ros2 bag record` does, and writes the serialized messages to an MCAP file of the profile `ros2`. It
answers each clock message on /recorded, so that a lockstep run continues only after the bag has all
earlier messages. It ends at SECONDS of sim time and prints its progress as a line of JSON each
second.
"""

import json
import os
import sys
import time
from pathlib import Path
from typing import Any

from udp_bridge_ros2.environment import apply_defaults

apply_defaults(os.environ)

import rclpy  # noqa: E402
from rclpy.node import Node  # noqa: E402
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy  # noqa: E402
from std_msgs.msg import Empty  # noqa: E402

from groundlink.core.clock import NANOS  # noqa: E402
from groundlink.recording.ros_channels import RecordedTopic, RosFile  # noqa: E402
from udp_bridge.node.message_class import message_class  # noqa: E402

BRIDGE = "udp_bridge"
ITS_OWN = {"/rosout", "/parameter_events", "/diagnostics"}
"""Topics that every node has, and what the bridge tells of itself."""

DEPTH = 4000
"""More than comes between two messages of the clock."""

LOOK_S = 0.05
"""How often it is looked what the bridge publishes; it waits 1 s before its first message."""

QUIET_S, LAST_S = 2.0, 10.0
"""At the end: what is under way is waited for until nothing more comes, and never longer."""

STAMPED_AT = 4
"""Where the stamp of a message with a header is, and of a clock: behind the CDR's four bytes."""

UNSTAMPED = ("TFMessage", "String", "DiagnosticArray")


class Bag(Node):
    """Records until its end."""

    def __init__(self, file: RosFile, end_nanos: int) -> None:
        super().__init__("bag")
        self._file = file
        self._end_nanos = end_nanos
        self._topics: dict[str, Any] = {}
        self._answer = self.create_publisher(Empty, "/recorded", 10)
        self.clock_nanos = -1
        self.messages = 0
        self._hears_all = False
        self._owes = False
        self.create_timer(LOOK_S, self._look)

    @property
    def is_over(self) -> bool:
        """Whether the run has come to the end."""
        return self.clock_nanos >= self._end_nanos

    def _look(self) -> None:
        """Subscribe to what the bridge has begun to publish; answer when all of it is heard."""
        try:
            found = self.get_publisher_names_and_types_by_node(BRIDGE, "/")
        except rclpy.node.NodeNameNonExistentError:
            return
        new = [(name, types[0]) for name, types in found if name not in {*self._topics, *ITS_OWN}]
        self._hears_all = self._hears_all or (
            not new and all(topic.get_publisher_count() for topic in self._topics.values())
        )
        self._give_answer()
        for name, ros_type in new:
            ends = self.get_publishers_info_by_topic(name)
            latched = any(
                end.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL for end in ends
            )
            channel = self._file.topic(name, ros_type, latched=latched)
            qos = QoSProfile(
                depth=DEPTH,
                reliability=ReliabilityPolicy.RELIABLE,
                durability=DurabilityPolicy.TRANSIENT_LOCAL
                if latched
                else DurabilityPolicy.VOLATILE,
            )
            self._topics[name] = self.create_subscription(
                message_class(ros_type), name, self._taker(channel), qos, raw=True
            )

    def _taker(self, channel: RecordedTopic) -> Any:
        is_clock = channel.name == "/clock"
        is_stamped = not channel.ros_type.endswith(UNSTAMPED)

        def take(cdr: bytes) -> None:
            nanos = stamp_nanos(cdr) if is_stamped else max(self.clock_nanos, 0)
            channel.write(nanos, memoryview(cdr))
            self.messages += 1
            if is_clock:
                self._tick(nanos)

        return take

    def _tick(self, nanos: int) -> None:
        self.clock_nanos = nanos
        # The first clock of an episode needs no answer, and the last one shall get none: time
        # stands.
        self._owes = nanos > 0 and not self.is_over
        self._give_answer()

    def _give_answer(self) -> None:
        """Answer the clock once all subscriptions are matched; unmatched messages would be lost."""
        if self._owes and self._hears_all:
            self._owes = False
            self._answer.publish(Empty())


def stamp_nanos(cdr: bytes) -> int:
    """Return the stamp of a serialized message that begins with one."""
    second, nanosecond = (
        int.from_bytes(cdr[at : at + 4], "little") for at in (STAMPED_AT, STAMPED_AT + 4)
    )
    return second * NANOS + nanosecond


def main(out: str, seconds: float) -> None:
    """Record until so many seconds of sim time."""
    rclpy.init()
    file = RosFile(Path(out))
    bag = Bag(file, round(seconds * NANOS))
    told_s, quiet_since_s, over_s, seen = 0.0, 0.0, 0.0, -1
    try:
        while True:
            rclpy.spin_once(bag, timeout_sec=0.1)
            now_s = time.monotonic()
            if bag.messages != seen:
                seen, quiet_since_s = bag.messages, now_s
            if bag.is_over:
                over_s = over_s or now_s
                if now_s - quiet_since_s > QUIET_S or now_s - over_s > LAST_S:
                    break
            if now_s - told_s > 1.0:
                told_s = now_s
                file.commit({})
                _tell(bag)
    except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
        pass
    file.commit({})
    file.close()
    _tell(bag)


def _tell(bag: Bag) -> None:
    words = {"seconds": max(bag.clock_nanos, 0) / NANOS, "messages": bag.messages}
    print(json.dumps(words), flush=True)


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]))
