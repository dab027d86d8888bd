# SPDX-License-Identifier: Apache-2.0
"""Bridge to ROS 2 nodes that run rmw_zenoh: publishes the gateway's topics on their Zenoh session.

Keys and attachments follow rmw_zenoh's design document; tests compare them with its examples.
Experimental: not tested against a real node. Zenoh's threads only queue messages; `arrived` yields
them. Services and delivery reports are not supported.
"""

import hashlib
import struct
from collections import deque
from collections.abc import Callable, Container, Iterable, Iterator, Mapping
from types import MappingProxyType

from groundlink.bus.session import Bus
from groundlink.ros.types import STORE
from groundlink.scenario.ros_side import RmwZenoh
from udp_bridge.wire.message import Message
from udp_bridge.wire.typed import typed_prefix
from udp_bridge.wire.types import MSG_TYPES, TYPED

from .subscribers import TopicKey

NODE = "groundlink"
"""Name of the gateway's node in the ROS graph."""

NO_HASH = "TypeHashNotSupported"
"""Placeholder that ROS 2 Humble uses instead of a type hash."""

QOS = "::,10:,:,:,,"
"""Reliable, volatile, keep last 10; empty fields have rmw_zenoh's defaults."""
QOS_LATCHED = ":1:,1:,:,:,,"
"""Reliable, transient local, keep last 1."""

WAITING = 256
"""Messages from ROS that may wait; beyond it the oldest are dropped."""

_ATTACHMENT = struct.Struct("<qqB16s")
PUBLISHER, SUBSCRIBER = "MP", "MS"


def data_key(domain_id: int, topic: str, ros_type: str, type_hash: str) -> str:
    """Return the key of a topic's messages; `*` as the hash matches all."""
    return f"{domain_id}/{topic.strip('/')}/{_dds_name(ros_type)}/{type_hash}"


def node_token(domain_id: int, session: str, node: str = NODE) -> str:
    """Return the liveliness key of the first node of a session."""
    return f"@ros2_lv/{domain_id}/{session}/0/0/NN/%/%/{node}"


def endpoint_token(
    domain_id: int,
    session: str,
    number: int,
    kind: str,
    topic: str,
    ros_type: str,
    type_hash: str,
    *,
    qos: str = QOS,
    node: str = NODE,
) -> str:
    """Return the liveliness key of a publisher or subscriber of that node.

    Parameters
    ----------
    number
        of the endpoint, which no other one of the session has.
    """
    where = f"@ros2_lv/{domain_id}/{session}/0/{number}/{kind}/%/%/{node}"
    return f"{where}/{topic.replace('/', '%')}/{_dds_name(ros_type)}/{type_hash}/{qos}"


def attachment(sequence: int, stamp_nanos: int, gid: bytes) -> bytes:
    """Return the attachment of a message, 33 bytes; subscribers discard messages without it.

    Parameters
    ----------
    sequence
        of the message, from 1.
    gid
        16 bytes that no other publisher has.
    """
    return _ATTACHMENT.pack(sequence, stamp_nanos, len(gid), gid)


def type_hash_of(ros_type: str) -> str:
    """Return the hash of a type, REP 2011, such as `RIHS01_df66...`."""
    return str(STORE.hash_rihs01(ros_type))


def _dds_name(ros_type: str) -> str:
    package, _, name = ros_type.split("/")
    return f"{package}::msg::dds_::{name}_"


class _Publisher:
    """Publisher of one topic."""

    def __init__(self, put: Callable[[bytes, bytes], None], token: str, latched: bool) -> None:
        self._put, self._latched = put, latched
        self._gid = hashlib.blake2b(token.encode(), digest_size=16).digest()
        self._sequence = 0
        self._last = b""

    def publish(self, stamp_nanos: int, cdr: bytes) -> None:
        if self._latched:
            if cdr == self._last:
                return
            self._last = cdr
        self._sequence += 1
        self._put(cdr, attachment(self._sequence, stamp_nanos, self._gid))


class RmwZenohBridge:
    """A node in the ROS graph that publishes and subscribes to the gateway's topics.

    Parameters
    ----------
    bus
        session of the ROS nodes; the caller closes it.
    to_ros, from_ros
        wire type and topic of publishers and subscriptions.
    latched
        topics to ROS that are kept for late subscribers, and published only when they change.
    typed
        ROS types of topics whose type has no number on the wire.
    """

    def __init__(
        self,
        bus: Bus,
        settings: RmwZenoh,
        to_ros: Iterable[TopicKey],
        from_ros: Iterable[TopicKey],
        latched: Container[TopicKey] = (),
        typed: Mapping[TopicKey, str] = MappingProxyType({}),
    ) -> None:
        domain, session = settings.domain_id, bus.identity
        self._publishers: dict[TopicKey, _Publisher] = {}
        self._arrived: deque[tuple[TopicKey, bytes]] = deque(maxlen=WAITING)
        bus.announce(node_token(domain, session))
        rows = [(PUBLISHER, place) for place in to_ros]
        rows += [(SUBSCRIBER, place) for place in from_ros]
        for number, (kind, place) in enumerate(rows, 1):
            ros_type, topic = typed.get(place) or str(MSG_TYPES[place[0]].ros_type), place[1]
            type_hash = type_hash_of(ros_type) if settings.type_hashes else NO_HASH
            is_latched = kind == PUBLISHER and place in latched
            token = endpoint_token(
                *(domain, session, number, kind, topic, ros_type, type_hash),
                qos=QOS_LATCHED if is_latched else QOS,
            )
            if kind == PUBLISHER:
                key = data_key(domain, topic, ros_type, type_hash)
                put = bus.publisher_of_bytes(key, cached=int(is_latched))
                self._publishers[place] = _Publisher(put, token, is_latched)
            else:
                key = data_key(domain, topic, ros_type, "*")
                prefix = typed_prefix(ros_type) if place[0] == TYPED else b""
                bus.subscribe_bytes(key, self._hand_over(place, prefix))
            bus.announce(token)

    def offers(self, place: TopicKey) -> bool:
        """Return whether this bridge publishes a topic."""
        return place in self._publishers

    def publish(self, place: TopicKey, stamp_nanos: int, cdr: memoryview) -> None:
        """Publish a message, if this bridge has its topic."""
        if (publisher := self._publishers.get(place)) is not None:
            publisher.publish(stamp_nanos, bytes(cdr))

    def arrived(self) -> Iterator[Message]:
        """Yield messages from ROS, in the form of wire messages."""
        while self._arrived:
            (msg_type, topic), body = self._arrived.popleft()
            yield Message(msg_type, topic, "", 0, 0, body)

    def _hand_over(self, place: TopicKey, prefix: bytes) -> Callable[[bytes], None]:
        return lambda body: self._arrived.append((place, prefix + body))


class NoRmwZenohBridge:
    """Stand-in where the scenario has no `gateway.rmw_zenoh`."""

    def offers(self, place: TopicKey) -> bool:
        """Return False."""
        return False

    def publish(self, place: TopicKey, stamp_nanos: int, cdr: memoryview) -> None:
        """Do nothing."""

    def arrived(self) -> Iterator[Message]:
        """Return nothing."""
        return iter(())
