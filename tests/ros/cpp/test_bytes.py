# SPDX-License-Identifier: Apache-2.0
"""What the node in C++ publishes and sends, compared byte by byte with the Python node."""

import logging
import socket
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from groundlink.messages.base import packed
from groundlink.messages.ground_truth import LabelTable
from groundlink.ros.cdr import to_cdr
from tests.ros.test_typed import MAGNETIC, magnetic_cdr
from tests.ros.waiting import wait_until
from tests.vectors.examples import EXAMPLES
from udp_bridge import Header, Link
from udp_bridge.node.bridge_node import BridgeNode, Settings
from udp_bridge.node.publish_queue import Publication
from udp_bridge.node.subscriptions import Subscription
from udp_bridge.wire.control import Subscribe
from udp_bridge.wire.header import parse
from udp_bridge.wire.typed import pack_typed
from udp_bridge.wire.types import SUBSCRIBE, TYPED, type_number

from .rclcpp_node import Published, RclcppNode

pytestmark = pytest.mark.system

LARGE_MAP = b"\0\1\0\0" + struct.pack("<iII", 7, 8, 4) + b"map\0" + bytes(100_000)
"""A body that begins as a nav_msgs/OccupancyGrid does; neither node reads the rest."""
LABEL_INFO = "vision_msgs/msg/LabelInfo"
LABEL_TABLE = LabelTable(0, "cam", ("person",), packed(np.array([20], np.uint16)))


class PlayedRos:
    """ROS of a Python node: keeps what is published, and passes on what the test says."""

    def __init__(self) -> None:
        self.published: list[Published] = []
        self.types: dict[str, str] = {}
        self._takes: dict[str, Any] = {}

    def get_logger(self) -> Any:
        return logging.getLogger(__name__)

    def publisher(self, row: Any, topic: str, qos: Any) -> Publication:
        if row.ros_type.startswith("no_such"):
            raise ImportError(row.ros_type)
        profile = f"{qos.depth},reliable" + ",latched" * qos.is_latched

        def publish(body: Any) -> None:
            self.published.append(Published(topic, row.ros_type, profile, bytes(body)))

        return Publication(publish, lambda: None)

    def type_of(self, topic: str) -> str:
        return self.types.get(topic, "")

    def subscribe(self, row: Any, topic: str, take: Any) -> Subscription:
        self._takes[topic] = take
        package, _, name = str(row.ros_type).partition("/msg/")
        fields = getattr(import_module(f"{package}.msg"), name).get_fields_and_field_types()
        return Subscription(fields.get("header") == "std_msgs/Header", lambda: None)

    def say(self, topic: str, body: bytes) -> bool:
        """Have a message come; return whether the topic is subscribed to."""
        if topic in self._takes:
            self._takes[topic](body)
        return topic in self._takes

    def now_nanos(self) -> int:
        return 0


def bodies() -> list[tuple[int, str, str, bytes]]:
    """Return type, topic, frame and body of a message of each type, and of some others."""
    rows = [
        (type_number(e.type_name), e.topic, "", bytes(to_cdr(e.message))) for e in EXAMPLES.values()
    ]
    typed = (TYPED, "/magnetic", "mast", pack_typed(MAGNETIC, magnetic_cdr()))
    names = (TYPED, "/label_info", "", pack_typed(LABEL_INFO, bytes(to_cdr(LABEL_TABLE))))
    clock = (8, "", "", b"\0\1\0\0" + bytes(8))
    twist = (9, "/cmd_vel", "", b"\0\1\0\0" + bytes(48))
    static = (35, "/rig/tf_static", "", bytes(to_cdr(EXAMPLES["transforms"].message)))
    large = (11, "/large", "map", LARGE_MAP)
    return [*rows, typed, names, clock, twist, static, static, large]


def wrong_bodies() -> list[tuple[int, str, str, bytes]]:
    """Return messages that neither node publishes."""
    return [
        (2, "/big_endian", "", b"\0\0\0\0" + bytes(300)),
        (2, "/empty", "", b""),
        (TYPED, "/unnamed", "", b"\x05abc"),
        (TYPED, "/unknown", "", pack_typed("no_such_msgs/msg/Thing", b"\0\1\0\0")),
    ]


def sent_to(address: tuple[str, int], stamp_nanos: int) -> None:
    """Send all messages, each after the last one has gone."""
    with Link(("127.0.0.1", 0), address) as link:
        for msg_type, topic, frame, body in [*wrong_bodies(), *bodies()]:
            link.send(msg_type, topic, frame, stamp_nanos, body)
            assert link.flush(10)


@contextmanager
def python_node(ros: Any, **settings: str) -> Iterator[BridgeNode]:
    node = BridgeNode(
        Settings(bind="127.0.0.1:0", **settings),
        ros,
        ros,
        ros,
        wake=lambda: None,
    )
    try:
        yield node
    finally:
        node.close()


def by_topic(published: list[Published]) -> dict[str, list[Published]]:
    """Return publications by topic: their order is defined within one."""
    topics: dict[str, list[Published]] = {}
    for row in list(published):
        topics.setdefault(row.topic, []).append(row)
    return topics


def test_every_type_is_published_as_by_the_python_node(memory_checked: Path, share: Path) -> None:
    ros = PlayedRos()
    with python_node(ros) as reference:
        sent_to(reference.link.address, 1_000)
        wait_until(lambda: len(ros.published) == len(bodies()) - 1)  # one was repeated
    with RclcppNode(memory_checked, share) as node:
        sent_to(node.address, 1_000)
        wait_until(lambda: len(node.published) == len(ros.published), "all messages")
    assert by_topic(node.published) == by_topic(ros.published)
    assert any(f"dropped {len(wrong_bodies())}, refused 0" in line for line in node.log), node.log
    said = "no_such_msgs/msg/Thing can't be published: ROS package no_such_msgs is not installed"
    assert sum(said in line for line in node.log) == 1


FROM_ROS = [
    (type_number(e.type_name), e.topic, bytes(to_cdr(e.message))) for e in EXAMPLES.values()
]


class Peer:
    """A peer without a library, which sees every datagram."""

    def __init__(self, node: tuple[str, int]) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self._node = node
        self._datagrams: list[tuple[Header, bytes]] = []

    def subscribe(self, msg_type: int, topic: str) -> None:
        header = Header(SUBSCRIBE, 0, 0, 1, 0, 0, topic).pack()
        self._socket.sendto(header + Subscribe(msg_type, lease_s=60).pack(), self._node)

    def of_topic(self, msg_type: int, topic: str) -> list[tuple[Header, bytes]]:
        """Return the datagrams of a topic so far, with their headers."""
        while True:
            try:
                datagram = self._socket.recv(65536)
            except BlockingIOError:
                break
            self._datagrams.append((parse(datagram)[0], datagram))
        key = (msg_type, topic)
        return [row for row in self._datagrams if (row[0].msg_type, row[0].topic) == key]

    def close(self) -> None:
        self._socket.close()


def sent_back(
    peer: Peer, say: Callable[[str, bytes], bool], turn: Callable[[], object]
) -> dict[tuple[int, str], list[bytes]]:
    """Return the datagrams of two messages of each type, without times of sending."""
    got: dict[tuple[int, str], list[bytes]] = {}
    rows = [*FROM_ROS, (11, "/large", LARGE_MAP), (TYPED, "/magnetic", magnetic_cdr())]
    for msg_type, topic, body in rows:
        peer.subscribe(msg_type, topic)

        def is_said(topic: str = topic, body: bytes = body) -> bool:
            turn()
            return say(topic, body)

        def has_come(number: int, msg_type: int = msg_type, topic: str = topic) -> bool:
            turn()
            heads = [head for head, _ in peer.of_topic(msg_type, topic)]
            return any(
                head.seq_number == number and head.part_number + 1 == head.parts_max
                for head in heads
            )

        for number in range(2):
            wait_until(is_said, topic)
            wait_until(lambda number=number: has_come(number), topic)  # type: ignore[misc]
        is_stamped = bool(peer.of_topic(msg_type, topic)[0][0].link)
        got[msg_type, topic] = [
            datagram if is_stamped else datagram[:8] + datagram[16:]
            for _, datagram in peer.of_topic(msg_type, topic)
        ]
    return got


def test_what_ros_publishes_is_sent_as_by_the_python_node(
    thread_checked: Path, share: Path
) -> None:
    ros = PlayedRos()
    ros.types["/magnetic"] = MAGNETIC
    with python_node(ros, datagram="mtu") as reference:
        peer = Peer(reference.link.address)
        wanted = sent_back(peer, ros.say, lambda: reference.turn(time.monotonic_ns()))
        peer.close()
    with RclcppNode(thread_checked, share, datagram="mtu") as node:
        node.say("publisher", "/magnetic", MAGNETIC)
        peer = Peer(node.address)

        def say(topic: str, body: bytes) -> bool:
            if not any(line.startswith(f"{topic} ") for line in node.subscribed):
                return False
            node.say("message", topic, body.hex())
            return True

        got = sent_back(peer, say, lambda: None)
        peer.close()
    assert got == wanted
    assert len(wanted[11, "/large"]) > 100
