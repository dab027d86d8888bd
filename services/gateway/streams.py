# SPDX-License-Identifier: Apache-2.0
"""Streams of a run to ROS, and topics of ROS that a run subscribes to.

The link repairs and queues each stream as the scenario says. How messages of ROS are read is
derived from the scenario and the tables of types.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial

from groundlink.messages.base import BadBusMessage, BusMessage
from groundlink.ros.cdr import CODECS, ROS_CODECS, Body, Reader, reader
from groundlink.ros.message_sizes import BESIDE_CLOUDS, body_bytes
from groundlink.ros.streams import Outgoing, incoming
from groundlink.scenario import Scenario
from groundlink.scenario.every_sensor import RepairBy
from udp_bridge.sender.repair import Mode, parse_mode
from udp_bridge.wire.control import Subscribe
from udp_bridge.wire.header import Refused
from udp_bridge.wire.message import Message as WireMessage
from udp_bridge.wire.typed import pack_typed, parse_typed
from udp_bridge.wire.types import MSG_TYPES, NUMBER_OF_ROS_TYPE, TYPED, type_number

from .subscribers import TopicKey

TF_MESSAGE = type_number("TFMessage")


def wire_type(message: type[BusMessage], ros_type: str = "") -> int:
    """Return the wire type of a stream's ROS type; `TYPED` for a ROS type without a number."""
    return NUMBER_OF_ROS_TYPE.get(ros_type or ROS_CODECS[message].ros_type, TYPED)


def wire_body(place: TopicKey, message: BusMessage, cdr: memoryview) -> memoryview:
    """Return the body that the wire carries: the CDR; for `TYPED`, the type's name before it."""
    if place[0] != TYPED:
        return cdr
    return memoryview(pack_typed(CODECS[type(message)].ros_type, cdr))


def queue_limits(streams: Iterable[Outgoing]) -> dict[tuple[int, str], int]:
    """Return the bytes that may wait of each stream sent in blocks, by wire type and topic.

    These are the bytes of a revolution, so a block waits no longer than a whole cloud would.
    """
    table = {}
    beside: dict[type[BusMessage], str] = {kind: name for name, (kind, _) in BESIDE_CLOUDS.items()}
    for stream in streams:
        if stream.in_blocks is not None:
            vehicle, lidar = stream.in_blocks
            block_bytes = body_bytes(vehicle, lidar, beside.get(stream.message, ""))
            whole = lidar.blocks_per_revolution * block_bytes
            table[wire_type(stream.message), stream.topic] = whole
    return table


def repair_table(streams: Iterable[Outgoing]) -> dict[tuple[int, str], Mode]:
    """Return the repair mode of each stream, by wire type and topic."""
    table = {}
    for stream in streams:
        repair = stream.repair
        if isinstance(repair, RepairBy):
            share = {"fec": repair.fec} if repair.fec is not None else {"resend": repair.resend}
            mode = parse_mode(share)
        else:
            mode = parse_mode(repair)
        if mode is not None:
            table[wire_type(stream.message), stream.topic] = mode
    return table


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


def _read_typed(body: Body, now_nanos: int, *, ros_type: str, read: Reader) -> BusMessage:
    """Read a body that begins with the name of its ROS type."""
    try:
        typed = parse_typed(body)
    except Refused as error:
        raise BadBusMessage(f"no type name: {error}") from None
    if typed.ros_type != ros_type:
        raise BadBusMessage(f"a {typed.ros_type}; expected {ros_type}")
    return read(memoryview(body)[typed.offset :], now_nanos)


class RosSubscriptions:
    """All topics that a run subscribes to in ROS."""

    def __init__(self, scenario: Scenario, run: str) -> None:
        self.typed: dict[TopicKey, str] = {}
        """ROS type of the topics whose type has no number on the wire."""

        subscriptions = []
        for stream in incoming(scenario, run):
            msg_type = wire_type(stream.message, stream.ros_type)
            ros_type = stream.ros_type if msg_type == TYPED else str(MSG_TYPES[msg_type].ros_type)
            read = reader(stream.message, ros_type, stream.joints)
            if msg_type == TYPED:
                read = partial(_read_typed, ros_type=ros_type, read=read)
                self.typed[msg_type, stream.topic] = ros_type
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
