# SPDX-License-Identifier: Apache-2.0
"""The gateway's topics for ROS 2 nodes that run rmw_zenoh: on their own Zenoh, without a bridge.

Rule: says only what rmw_zenoh's design document says, key by key and byte by byte: tests hold it to
that document's examples. Experimental: no such node has been met. Zenoh's threads only hand over;
what came is read by who calls `arrived`. Services, and reports of what arrived, there are none.
"""

from __future__ import annotations

import hashlib
import struct
from collections import deque
from collections.abc import Callable, Container, Iterable, Iterator

from groundlink.bus.session import Bus
from groundlink.ros.types import STORE
from groundlink.scenario.ros_side import RmwZenoh
from udp_bridge.wire.message import Message
from udp_bridge.wire.types import MSG_TYPES

from .subscribers import TopicKey

NODE = "groundlink"
"""The name under which the gateway stands in the graph of ROS."""

NO_HASH = "TypeHashNotSupported"
"""What Humble writes where others write the hash of a type."""

QOS = "::,10:,:,:,,"
"""Reliable, volatile, the last 10 kept: what is empty is rmw_zenoh's default."""
QOS_LATCHED = ":1:,1:,:,:,,"
"""Reliable, transient local, the last one kept."""

WAITING = 256
"""Messages from ROS that may wait: the newest are kept."""

_ATTACHMENT = struct.Struct("<qqB16s")
PUBLISHER, SUBSCRIBER = "MP", "MS"


def data_key(domain_id: int, topic: str, ros_type: str, type_hash: str) -> str:
    """Return the key on which a topic's messages go; `*` as the hash matches all."""
    return f"{domain_id}/{topic.strip('/')}/{_dds_name(ros_type)}/{type_hash}"


def node_token(domain_id: int, session: str, node: str = NODE) -> str:
    """Return the liveliness key by which a node, the first of its session, is there."""
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
    """Return what goes with each message, without which a subscriber discards it: 33 bytes.

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
    """One topic on its way to ROS."""

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
    """A node in the graph of ROS that publishes and subscribes what the gateway carries.

    Parameters
    ----------
    bus
        of the ROS nodes; whoever made it closes it.
    to_ros, from_ros
        wire type and topic of what goes there, and of what is wanted from there.
    latched
        of what goes there: kept for who comes late, published again only when it has changed.
    """

    def __init__(
        self,
        bus: Bus,
        settings: RmwZenoh,
        to_ros: Iterable[TopicKey],
        from_ros: Iterable[TopicKey],
        latched: Container[TopicKey] = (),
    ) -> None:
        domain, session = settings.domain_id, bus.identity
        self._publishers: dict[TopicKey, _Publisher] = {}
        self._arrived: deque[tuple[TopicKey, bytes]] = deque(maxlen=WAITING)
        bus.announce(node_token(domain, session))
        rows = [(PUBLISHER, place) for place in to_ros]
        rows += [(SUBSCRIBER, place) for place in from_ros]
        for number, (kind, place) in enumerate(rows, 1):
            ros_type, topic = str(MSG_TYPES[place[0]].ros_type), place[1]
            type_hash = type_hash_of(ros_type) if settings.type_hashes else NO_HASH
            is_latched = kind == PUBLISHER and place in latched
            token = endpoint_token(
                *(domain, session, number, kind, topic, ros_type, type_hash),
                qos=QOS_LATCHED if is_latched else QOS,
            )
            if kind == PUBLISHER:
                key = data_key(domain, topic, ros_type, type_hash)
                put = bus.publisher_of_bytes(key, kept=int(is_latched))
                self._publishers[place] = _Publisher(put, token, is_latched)
            else:
                key = data_key(domain, topic, ros_type, "*")
                bus.subscribe_bytes(key, self._hand_over(place))
            bus.announce(token)

    def offers(self, place: TopicKey) -> bool:
        """Return whether a topic goes to ROS here."""
        return place in self._publishers

    def publish(self, place: TopicKey, stamp_nanos: int, cdr: memoryview) -> None:
        """Publish a message, if its topic goes to ROS here."""
        if (publisher := self._publishers.get(place)) is not None:
            publisher.publish(stamp_nanos, bytes(cdr))

    def arrived(self) -> Iterator[Message]:
        """Return what has come from ROS, as the wire would bring it."""
        while self._arrived:
            (msg_type, topic), body = self._arrived.popleft()
            yield Message(msg_type, topic, "", 0, 0, body)

    def _hand_over(self, place: TopicKey) -> Callable[[bytes], None]:
        return lambda body: self._arrived.append((place, body))


class NoRmwZenohBridge:
    """What stands in its place where no node runs rmw_zenoh."""

    def offers(self, place: TopicKey) -> bool:
        """Return that it does not."""
        return False

    def publish(self, place: TopicKey, stamp_nanos: int, cdr: memoryview) -> None:
        """Do nothing."""

    def arrived(self) -> Iterator[Message]:
        """Return nothing."""
        return iter(())
