# SPDX-License-Identifier: Apache-2.0
"""The queues between the receiving thread and ROS, with a stand-in for the node and publishers."""

import logging
import threading
from typing import Any

import pytest

from udp_bridge import Message
from udp_bridge.node import publish_queue as module
from udp_bridge.node.publish_queue import MAX_TOPICS, QUICK_SECONDS, PublishQueue

from .waiting import wait_until

pytest.importorskip("rclpy", reason="no ROS 2 here")
from udp_bridge_ros2 import topics
from udp_bridge_ros2.topics import Ros2Publishers

SENDER = ("127.0.0.1", 1)


@pytest.fixture(autouse=True)
def plain_publishing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Publish by the stand-in below, which has no address in rcl."""
    publish = lambda publisher: lambda body: publisher.publish(body)  # noqa: E731
    monkeypatch.setattr(topics, "serialized_publish", publish)


class Node:
    """A node whose publisher publishes only when it may."""

    def __init__(self) -> None:
        self.may_publish = threading.Event()
        self.is_publishing = threading.Event()
        self.bodies: list[bytes] = []

    def create_publisher(self, *_: Any, **__: Any) -> "Node":
        return self

    def publish(self, body: bytes) -> None:
        self.is_publishing.set()
        assert self.may_publish.wait(10.0)
        self.bodies.append(body)

    def get_logger(self) -> logging.Logger:
        return logging.getLogger(__name__)


def body(number: int, size: int = 1) -> bytes:
    return b"\x00\x01\x00\x00" + bytes([number]) * size


def put(queue: PublishQueue, msg_type: int, topic: str, number: int, size: int = 1) -> None:
    message = Message(msg_type, topic, "", 0, 0, body(number, size))
    queue.put(message, SENDER)


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
    queue = PublishQueue(Ros2Publishers(node))  # type: ignore[arg-type]
    put(queue, msg_type, "/topic", 0, size)
    assert node.is_publishing.wait(10.0)
    for number in range(1, 10):
        put(queue, msg_type, "/topic", number, size)
    node.may_publish.set()
    wait_until(lambda: len(node.bodies) == len(published), "the messages that waited")
    queue.close()
    assert node.bodies == [body(number, size) for number in published]
    assert queue.published == len(published)
    assert queue.dropped == 10 - len(published)


def test_topics_are_bounded() -> None:
    node = Node()
    node.may_publish.set()
    queue = PublishQueue(Ros2Publishers(node))  # type: ignore[arg-type]
    for number in range(MAX_TOPICS + 5):
        put(queue, 2, f"/topic{number}", 0)
    wait_until(lambda: queue.published == MAX_TOPICS, "all that has a topic")
    queue.close()
    assert queue.refused == 5
    assert queue.topic_count == MAX_TOPICS


class QuickNode(Node):
    """A node whose publisher takes as long as it is told, by clocks that stand still otherwise."""

    def __init__(self) -> None:
        super().__init__()
        self.may_publish.set()
        self.now_s = 1000.0
        self.takes_s = 0.0
        self.threads: list[str] = []

    def monotonic(self) -> float:
        return self.now_s

    def publish(self, body: bytes) -> None:
        self.now_s += self.takes_s
        self.threads.append(threading.current_thread().name)
        super().publish(body)


@pytest.fixture
def node(monkeypatch: pytest.MonkeyPatch) -> QuickNode:
    node = QuickNode()
    monkeypatch.setattr(module, "time", node)
    return node


def test_messages_of_a_quick_topic_are_published_where_they_come(node: QuickNode) -> None:
    queue = PublishQueue(Ros2Publishers(node))  # type: ignore[arg-type]
    here = threading.current_thread().name

    def publish(number: int, size: int = 1, msg_type: int = 2, topic: str = "/topic") -> str:
        put(queue, msg_type, topic, number, size)
        wait_until(lambda: len(node.bodies) == number + 1, "the message")
        wait_until(lambda: queue.published == number + 1, "it is counted")
        wait_until(lambda: not any(c.is_publishing for c in queue._channels.values()), "rest")
        return node.threads[-1]

    assert publish(0) == "publish"  # which creates the publisher
    assert publish(1) == here
    assert publish(2, 1_300_000) == here
    node.takes_s = 2 * QUICK_SECONDS
    assert publish(3) == here
    assert publish(4) == "publish"
    node.takes_s = 0.0
    assert publish(5) == "publish"
    assert publish(6) == here
    assert publish(7, msg_type=35, topic="/tf_static") == "publish"
    assert publish(8, msg_type=35, topic="/tf_static") == "publish"  # it is latched
    queue.close()
    assert [b[4] for b in node.bodies] == list(range(9))


def test_nothing_overtakes_what_waits_or_is_being_published(node: QuickNode) -> None:
    queue = PublishQueue(Ros2Publishers(node))  # type: ignore[arg-type]
    put(queue, 2, "/topic", 0)
    wait_until(lambda: queue.published == 1, "the first, which creates the publisher")
    wait_until(lambda: not any(c.is_publishing for c in queue._channels.values()), "rest")
    (channel,) = queue._channels.values()
    channel.took_s = 2 * QUICK_SECONDS
    node.may_publish.clear()
    node.is_publishing.clear()
    put(queue, 2, "/topic", 1)
    assert node.is_publishing.wait(10.0)
    put(queue, 2, "/topic", 2)  # while one is being published
    put(queue, 2, "/topic", 3)  # while one waits
    node.may_publish.set()
    wait_until(lambda: len(node.bodies) == 4, "all of them")
    queue.close()
    assert [b[4] for b in node.bodies] == [0, 1, 2, 3]


def test_nothing_overtakes_what_is_about_to_be_taken(node: QuickNode) -> None:
    queue = PublishQueue(Ros2Publishers(node))  # type: ignore[arg-type]
    put(queue, 2, "/topic", 0)
    wait_until(lambda: queue.published == 1, "the first, which creates the publisher")
    (channel,) = queue._channels.values()
    wait_until(lambda: not channel.is_publishing, "rest")
    channel.waiting.append((Message(2, "/topic", "", 0, 0, body(1)), SENDER))
    put(queue, 2, "/topic", 2)
    wait_until(lambda: len(node.bodies) == 2, "the one that waited")
    queue.close()
    assert [b[4] for b in node.bodies] == [0, 1]
    assert [message.body[4] for message, _ in channel.waiting] == [2]


def test_what_ros_refuses_is_counted_where_it_comes(node: QuickNode) -> None:
    outcomes: list[bool] = []
    queue = PublishQueue(Ros2Publishers(node), lambda *outcome: outcomes.append(outcome[2]))  # type: ignore[arg-type]
    put(queue, 2, "/topic", 0)
    wait_until(lambda: outcomes == [True], "the first, which creates the publisher")
    wait_until(lambda: not any(c.is_publishing for c in queue._channels.values()), "rest")

    def fail(body: bytes) -> None:
        raise RuntimeError("no")

    node.publish = fail  # type: ignore[method-assign]
    put(queue, 2, "/topic", 1)
    assert outcomes == [True, False]
    queue.close()
    assert (queue.published, queue.refused, queue.dropped) == (1, 1, 0)
