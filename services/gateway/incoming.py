# SPDX-License-Identifier: Apache-2.0
"""What comes from ROS: which topics are wished for, and what each message is on the bus.

Rule: derived from the scenario and the tables of types alone; the way out is `streams`. What comes
from ROS is wished for as long as the gateway lives, and nothing comes that was not wished for.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from groundlink.messages import BadMessage, Message
from groundlink.ros_incoming import READERS
from groundlink.scenario import Scenario
from groundlink.topics import COMMAND, FROM_ROS
from udp_bridge.control import Subscribe
from udp_bridge.message import Message as WireMessage
from udp_bridge.types import MSG_TYPES, type_number

TWIST = type_number("Twist")

_TYPES = {
    "pose": type_number("PoseStamped"),
    "odometry": type_number("Odometry"),
    "map": type_number("OccupancyGrid"),
}
"""The wire's types by field of the scenario's `from_ros`."""

LATCHED = frozenset({_TYPES["map"]})
"""Published once and kept for those that come late."""

LEASE_SECONDS = 3
"""Of the gateway's wishes; they are repeated every second."""


@dataclass(frozen=True, kw_only=True)
class Wish:
    """A topic of ROS that has a place on the bus."""

    msg_type: int
    topic: str
    key: str

    def subscribe(self) -> bytes:
        """Return the body of the Subscribe that asks for it."""
        return Subscribe(self.msg_type, lease_s=LEASE_SECONDS).pack()

    def forget(self) -> bytes:
        """Return the body of the Subscribe that ends it."""
        return Subscribe(self.msg_type, action=0).pack()

    def read(self, message: WireMessage, now_nanos: int) -> Message:
        """Return what a message is on the bus.

        Raises
        ------
        BadMessage
            when the body is not what its type says.
        """
        ros_type = MSG_TYPES[self.msg_type].ros_type
        assert ros_type is not None
        return READERS[ros_type](message.body, now_nanos)


class Incoming:
    """All that a run wishes from ROS."""

    def __init__(self, scenario: Scenario, run: str) -> None:
        self._by_topic = {(w.msg_type, w.topic): w for w in _wishes(scenario, run)}

    def __iter__(self) -> Iterator[Wish]:
        return iter(self._by_topic.values())

    def read(self, message: WireMessage, now_nanos: int | None) -> tuple[str, Message]:
        """Return a message as the bus has it, with its key; `now_nanos` is the run's time.

        Raises
        ------
        BadMessage
            when nobody wished for it, it is not what its type says, or the run has no time yet.
        """
        wish = self._by_topic.get((message.msg_type, message.topic))
        if wish is None or now_nanos is None:
            raise BadMessage(f"nobody wishes {message.topic} yet")
        return wish.key, wish.read(message, now_nanos)


def _wishes(scenario: Scenario, run: str) -> Iterator[Wish]:
    for vehicle in scenario.vehicles:
        key = COMMAND.key_in(run, vehicle=vehicle.name)
        yield Wish(msg_type=TWIST, topic=vehicle.command_topic, key=key)
        for name, row in FROM_ROS.items():
            if topic := getattr(vehicle.from_ros, name):
                key = row.key_in(run, vehicle=vehicle.name)
                yield Wish(msg_type=_TYPES[name], topic=topic, key=key)
