# SPDX-License-Identifier: Apache-2.0
"""The queues between the receiving thread and ROS, with a stand-in for the node and publishers."""

from __future__ import annotations

import logging
import threading
from typing import Any

import pytest

from udp_bridge import MSG_TYPES, Message

from .waiting import wait_until

pytest.importorskip("rclpy", reason="no ROS 2 here")
from udp_bridge_ros2.outlet import MAX_TOPICS, Outlet

SENDER = ("127.0.0.1", 1)


class Node:
    """A node whose publisher publishes only when it may."""

    def __init__(self) -> None:
        self.may_publish = threading.Event()
        self.is_publishing = threading.Event()
        self.bodies: list[bytes] = []

    def create_publisher(self, *_: Any) -> Node:
        return self

    def publish(self, body: bytes) -> None:
        self.is_publishing.set()
        assert self.may_publish.wait(10.0)
        self.bodies.append(body)

    def get_logger(self) -> logging.Logger:
        return logging.getLogger(__name__)


def body(number: int, size: int = 1) -> bytes:
    return b"\x00\x01\x00\x00" + bytes([number]) * size


def put(outlet: Outlet, msg_type: int, topic: str, number: int, size: int = 1) -> None:
    message = Message(msg_type, topic, "", 0, 0, body(number, size))
    outlet.put(MSG_TYPES[msg_type], message, SENDER)


@pytest.mark.parametrize(
    ("msg_type", "size", "published"),
    [
        (1, 1_300_000, [0, 7, 8, 9]),
        (1, 200_000, [0, 5, 6, 7, 8, 9]),
        (1, 50_000, list(range(10))),
        (2, 324, list(range(10))),
    ],
    ids=["large: the newest win", "a megabyte waits", "blocks: all wait", "small: all wait"],
)
def test_while_publishing_stalls(msg_type: int, size: int, published: list[int]) -> None:
    node = Node()
    outlet = Outlet(node)  # type: ignore[arg-type]
    put(outlet, msg_type, "/topic", 0, size)
    assert node.is_publishing.wait(10.0)
    for number in range(1, 10):
        put(outlet, msg_type, "/topic", number, size)
    node.may_publish.set()
    wait_until(lambda: len(node.bodies) == len(published), "the messages that waited")
    outlet.close()
    assert node.bodies == [body(number, size) for number in published]
    assert outlet.published == len(published)
    assert outlet.dropped == 10 - len(published)


def test_topics_are_bounded() -> None:
    node = Node()
    node.may_publish.set()
    outlet = Outlet(node)  # type: ignore[arg-type]
    for number in range(MAX_TOPICS + 5):
        put(outlet, 2, f"/topic{number}", 0)
    wait_until(lambda: outlet.published == MAX_TOPICS, "all that has a topic")
    outlet.close()
    assert outlet.refused == 5
    assert outlet.topic_count == MAX_TOPICS
