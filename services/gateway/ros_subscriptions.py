# SPDX-License-Identifier: Apache-2.0
"""Topics of ROS that a run subscribes to, and how their messages are read.

Derived from the scenario and the tables of types. `streams` has the other direction.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from groundlink.messages.base import BadBusMessage, BusMessage
from groundlink.ros.cdr import Body, reader
from groundlink.ros.streams import incoming
from groundlink.scenario import Scenario
from udp_bridge.wire.control import Subscribe
from udp_bridge.wire.message import Message as WireMessage
from udp_bridge.wire.types import MSG_TYPES, type_number

from .streams import wire_type

LATCHED = frozenset({type_number("OccupancyGrid")})
"""Published once and kept for late subscribers."""

LEASE_SECONDS = 10
"""Lease of a subscription. The gateway renews it every second, but its machine may be busy; in
lockstep, a message that is published without a subscription would be missing for good."""


@dataclass(frozen=True, kw_only=True)
class RosSubscription:
    """A topic of ROS with its key on the bus."""

    msg_type: int
    topic: str
    key: str
    reader: Callable[[Body, int], BusMessage]
    """Reads a body, received at a time of the run."""

    def subscribe(self) -> bytes:
        """Return the body of a Subscribe message that begins or renews it."""
        return Subscribe(self.msg_type, lease_s=LEASE_SECONDS).pack()

    def unsubscribe(self) -> bytes:
        """Return the body of a Subscribe message that ends it."""
        return Subscribe(self.msg_type, action=0).pack()

    def read(self, message: WireMessage, now_nanos: int) -> BusMessage:
        """Return a message as the bus has it.

        Raises
        ------
        BadBusMessage
            when the body does not fit its type.
        """
        return self.reader(message.body, now_nanos)


class RosSubscriptions:
    """All topics that a run subscribes to in ROS."""

    def __init__(self, scenario: Scenario, run: str) -> None:
        subscriptions = []
        for stream in incoming(scenario, run):
            msg_type = wire_type(stream.message, stream.ros_type)
            read = reader(stream.message, str(MSG_TYPES[msg_type].ros_type))
            subscriptions.append(
                RosSubscription(msg_type=msg_type, topic=stream.topic, key=stream.key, reader=read)
            )
        self._by_topic = {(each.msg_type, each.topic): each for each in subscriptions}

    def __iter__(self) -> Iterator[RosSubscription]:
        return iter(self._by_topic.values())

    def read(self, message: WireMessage, now_nanos: int | None) -> tuple[str, BusMessage]:
        """Return a message as the bus has it, with its key; `now_nanos` is the run's time.

        Raises
        ------
        BadBusMessage
            when it was not subscribed to, does not fit its type, or the run has no time yet.
        """
        each = self._by_topic.get((message.msg_type, message.topic))
        if each is None or now_nanos is None:
            raise BadBusMessage(f"{message.topic} is not subscribed to, or the run has no time yet")
        return each.key, each.read(message, now_nanos)
