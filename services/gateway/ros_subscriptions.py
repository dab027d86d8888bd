# SPDX-License-Identifier: Apache-2.0
"""What comes from ROS: which topics are wished for, and what each message is on the bus.

Rule: derived from the scenario and the tables of types alone; the way out is `streams`. What comes
from ROS is wished for as long as the gateway lives, and nothing comes that was not wished for.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from groundlink.messages.base import BadMessage, Message
from groundlink.ros.cdr import Body, reader
from groundlink.ros.streams import incoming
from groundlink.scenario import Scenario
from udp_bridge.wire.control import Subscribe
from udp_bridge.wire.message import Message as WireMessage
from udp_bridge.wire.types import MSG_TYPES, type_number

from .streams import wire_type

LATCHED = frozenset({type_number("OccupancyGrid")})
"""Published once and kept for those that come late."""

LEASE_SECONDS = 10
"""Of the gateway's wishes, which are repeated every second, on a machine that may be busy. In
lockstep an answer that comes while nobody subscribes would be waited for in vain."""


@dataclass(frozen=True, kw_only=True)
class RosSubscription:
    """A topic of ROS that has a place on the bus."""

    msg_type: int
    topic: str
    key: str
    reader: Callable[[Body, int], Message]
    """Of bodies, at the run's time."""

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
        return self.reader(message.body, now_nanos)


class RosSubscriptions:
    """All that a run wishes from ROS."""

    def __init__(self, scenario: Scenario, run: str) -> None:
        wishes = []
        for stream in incoming(scenario, run):
            msg_type = wire_type(stream.message, stream.ros_type)
            read = reader(stream.message, str(MSG_TYPES[msg_type].ros_type))
            wishes.append(
                RosSubscription(msg_type=msg_type, topic=stream.topic, key=stream.key, reader=read)
            )
        self._by_topic = {(wish.msg_type, wish.topic): wish for wish in wishes}

    def __iter__(self) -> Iterator[RosSubscription]:
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
