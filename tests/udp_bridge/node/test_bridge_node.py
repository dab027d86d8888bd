# SPDX-License-Identifier: Apache-2.0
"""The end that both nodes are, with a real link and a ROS that the test plays."""

import logging
import random
import threading
from typing import Any

import pytest

from tests.ros.waiting import wait_until
from udp_bridge import Link
from udp_bridge.node import bridge_node as module
from udp_bridge.node.bridge_node import BridgeNode, Settings
from udp_bridge.node.publish_queue import Publication
from udp_bridge.node.subscriptions import Subscription
from udp_bridge.wire import control
from udp_bridge.wire.control import Subscribe, WorldQuery, WorldReply
from udp_bridge.wire.types import CONTROL, SUBSCRIBE, type_number

TEXT, TWIST = type_number("String"), type_number("Twist")
BODY = b"\x00\x01\x00\x00\x02\x00\x00\x00a\x00"
ANYWHERE = ("127.0.0.1", 0)


class Ros:
    """Publishers, subscriptions and graph in one."""

    def __init__(self) -> None:
        self.bodies: list[bytes] = []
        self.subscribed: list[str] = []
        self.published: list[str] = []

    def get_logger(self) -> logging.Logger:
        return logging.getLogger(__name__)

    def publisher(self, row: Any, topic: str, *_: Any) -> Publication:
        self.published.append(topic)
        return Publication(
            lambda body: self.bodies.append(bytes(body)), lambda: self.published.remove(topic)
        )

    def subscribe(self, row: Any, topic: str, take: Any) -> Subscription:
        self.subscribed.append(topic)
        return Subscription(False, lambda: None)

    def now_nanos(self) -> int:
        return 0


class Hasty(Link):
    """A link that has had a message handed over before its constructor returns."""

    def __init__(self, bind: Any, *, on_message: Any, **others: Any) -> None:
        begun = threading.Event()

        def take(message: Any, sender: Any) -> None:
            begun.set()
            on_message(message, sender)

        super().__init__(bind, on_message=take, **others)
        with Link(ANYWHERE, self.address) as other:
            other.send(TEXT, "/text", "", 1, BODY)
            assert begun.wait(10)


@pytest.fixture
def ros() -> Ros:
    return Ros()


def made(ros: Any, **settings: str) -> BridgeNode:
    return BridgeNode(
        Settings(**{"bind": "127.0.0.1:0"} | settings), ros, ros, ros, wake=lambda: None
    )


def test_what_comes_before_all_is_there_waits_for_it(
    ros: Ros, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(module, "Link", Hasty)
    end = made(ros)
    wait_until(lambda: ros.bodies == [BODY], "the message")
    end.close()
    assert not [row for row in caplog.records if row.levelno >= logging.ERROR]


def test_a_subscription_is_served_and_a_stranger_is_refused(
    ros: Ros, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    with Link(ANYWHERE) as peer, Link(ANYWHERE) as stranger:
        end = made(ros, peer=f"127.0.0.1:{peer.address[1]}")
        for link, topic in ((stranger, "/others"), (peer, "/cmd_vel")):
            link.send(SUBSCRIBE, topic, "", 1, Subscribe(TWIST).pack(), end.link.address)

        def is_served() -> bool:
            end.turn(0)
            return bool(ros.subscribed)

        wait_until(is_served, "a subscription")
        end.close()
    assert ros.subscribed == ["/cmd_vel"]
    assert caplog.messages[-1].endswith("0 sent back; lost 0, superseded 0, refused 1")


def test_an_address_in_use_leaves_no_thread(ros: Ros) -> None:
    before = threading.active_count()
    with Link(ANYWHERE) as other:
        busy = threading.active_count()
        with pytest.raises(OSError, match="can't bind"):
            made(ros, bind=f"127.0.0.1:{other.address[1]}")
        assert threading.active_count() == busy
    assert threading.active_count() == before


def test_a_large_world_query_is_one_datagram_each_way_at_any_datagram_size(ros: Ros) -> None:
    text = random.Random(1).randbytes(50_000).hex()  # 60 kB compressed

    def answer(message: Any, sender: Any) -> None:
        if message.msg_type == CONTROL and isinstance(
            query := control.parse(message.body), WorldQuery
        ):
            reply = WorldReply(query.number, query.packed_text)
            gateway.send(CONTROL, "", "", 1, reply.pack(), sender)

    with Link(ANYWHERE, datagram="mtu", on_message=answer) as gateway:
        end = made(ros, peer=f"127.0.0.1:{gateway.address[1]}", datagram="mtu")
        end.command_client.gateway_seen(gateway.address)
        assert end.command_client.ask(text) == text
        end.close()
