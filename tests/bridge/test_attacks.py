# SPDX-License-Identifier: Apache-2.0
"""Attacks on the ROS side of a bridge over real sockets, and the answers they draw.

All traffic is on loopback. Where the attacker is on another host, `is_local` is replaced, so that
a loopback address counts as any other one.
"""

import logging
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager

import pytest

from tests.ros.waiting import wait_until
from tests.udp_bridge.io.test_address_guard import other_hosts as other_hosts
from tests.udp_bridge.node.test_bridge_node import Ros, made
from udp_bridge import Header, Link
from udp_bridge.node import lockstep, publish_queue, subscriptions
from udp_bridge.node.bridge_node import BridgeNode
from udp_bridge.wire import address_validation
from udp_bridge.wire.control import AddressChallenge, CreditRequest, Subscribe, parse
from udp_bridge.wire.header import parse as parse_header
from udp_bridge.wire.lockstep import Barrier, SentMessages
from udp_bridge.wire.message import Address
from udp_bridge.wire.types import CONTROL, SUBSCRIBE, type_number

TEXT, TWIST = type_number("String"), type_number("Twist")
BODY = b"\x00\x01\x00\x00\x02\x00\x00\x00a\x00"
ANYWHERE = ("127.0.0.1", 0)
LISTEN_S = 2.5
"""Reports go out once a second."""


def datagram(msg_type: int, topic: str, body: bytes, number: int = 0) -> bytes:
    return Header(msg_type, number, 0, 1, 1, 0, topic).pack() + body


class Attacker:
    """A socket that sends datagrams and counts what comes back."""

    def __init__(self, to: Address) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(ANYWHERE)
        self._socket.settimeout(0.05)
        self._to = to
        self.sent_bytes = 0
        self.drawn: list[bytes] = []

    @property
    def address(self) -> Address:
        name: Address = self._socket.getsockname()
        return name

    def send(self, data: bytes) -> None:
        self.sent_bytes += len(data)
        self._socket.sendto(data, self._to)

    def listen(self, seconds: float) -> None:
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            try:
                self.drawn.append(self._socket.recv(1 << 16))
            except TimeoutError:
                pass

    @property
    def drawn_bytes(self) -> int:
        return sum(map(len, self.drawn))

    def close(self) -> None:
        self._socket.close()


@pytest.fixture
def ros() -> Ros:
    return Ros()


def ended(ros: Ros, **settings: str) -> AbstractContextManager[BridgeNode]:
    """Return a node that is closed in the end."""
    return closing(made(ros, **settings))


@contextmanager
def attackers(node: BridgeNode, count: int = 1) -> Iterator[list[Attacker]]:
    to = ("127.0.0.1", node.link.address[1])
    with ExitStack() as stack:
        yield [stack.enter_context(closing(Attacker(to))) for _ in range(count)]


def until_served(
    node: BridgeNode, ask: Callable[[], object], is_served: Callable[[], object]
) -> None:
    """Ask again and again until a subscription is served."""

    def is_there() -> object:
        ask()
        node.turn(time.monotonic_ns())
        return is_served()

    wait_until(is_there, "a subscription")


def subscribe(gateway: Link) -> None:
    gateway.send(SUBSCRIBE, "/cmd_vel", "", 1, Subscribe(TWIST).pack())


OPEN = {"bind": "0.0.0.0:0", "allow_any_peer": "true"}
"""Settings of a node that any sender reaches."""


def test_an_unknown_sender_draws_nothing_if_a_peer_is_named(ros: Ros) -> None:
    with Link(ANYWHERE) as peer, ended(ros, peer=f"127.0.0.1:{peer.address[1]}") as node:
        with attackers(node) as (one,):
            one.send(datagram(TEXT, "/text", BODY))
            one.send(datagram(CONTROL, "", CreditRequest().pack()))
            one.send(datagram(SUBSCRIBE, "/cmd_vel", Subscribe(TWIST).pack()))
            one.listen(LISTEN_S)
            assert one.drawn == []
        assert ros.bodies == []
        assert node.link.counters()["refused"] == {"stranger": 3}


@pytest.mark.parametrize("size", [1, 2])
def test_an_unvalidated_address_draws_no_more_bytes_than_it_sent(
    ros: Ros, other_hosts: None, size: int
) -> None:
    with ended(ros, **OPEN) as node, attackers(node) as (one,):
        for number in range(20):
            one.send(datagram(TEXT, "", BODY, number))
            one.send(Header(1, number, 1, 2, 1, 0, "").pack() + bytes(size))  # the last of two
            one.send(datagram(CONTROL, "", CreditRequest().pack()))
            one.send(datagram(SUBSCRIBE, "", Subscribe(TWIST).pack()))
            one.send(datagram(CONTROL, "", Barrier(1, -1, 100).pack()))
        one.listen(LISTEN_S)
        assert 0 < one.drawn_bytes <= one.sent_bytes
        assert ros.bodies


def test_a_stream_starts_once_its_receiver_has_proved_its_address(
    ros: Ros, other_hosts: None
) -> None:
    def cookies(one: Attacker) -> list[bytes]:
        bodies = [data[parse_header(data)[1] :] for data in one.drawn]
        return [said.cookie for said in map(parse, bodies) if isinstance(said, AddressChallenge)]

    wanted = datagram(SUBSCRIBE, "/cmd_vel", Subscribe(TWIST).pack())
    with (
        ended(ros, **OPEN) as node,
        attackers(node, 2) as (spoofed, live),
    ):
        spoofed.send(wanted)
        live.send(wanted)
        for one in (spoofed, live):
            one.listen(0.5)
        node.turn(0)
        assert ros.subscribed == []
        # The cookie of one address proves nothing about another one.
        (theirs,), (own,) = cookies(spoofed), cookies(live)
        live.send(datagram(CONTROL, "", address_validation.AddressResponse(theirs).pack()))
        live.send(wanted)
        live.listen(0.5)
        node.turn(0)
        assert ros.subscribed == []
        live.send(datagram(CONTROL, "", address_validation.AddressResponse(own).pack()))
        live.send(wanted)
        until_served(node, lambda: None, lambda: ros.subscribed)
        assert node.link.counters()["refused"]["unvalidated"] == 3


def test_a_link_that_sends_somewhere_returns_the_cookie_from_there(
    ros: Ros, other_hosts: None
) -> None:
    with ended(ros, **OPEN) as node:
        there = ("127.0.0.1", node.link.address[1])
        with Link(ANYWHERE, there) as gateway:
            until_served(node, lambda: subscribe(gateway), lambda: ros.subscribed)


def test_a_stream_ends_with_the_validation_of_its_address(
    ros: Ros, other_hosts: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    with ended(ros, **OPEN) as node:
        there = ("127.0.0.1", node.link.address[1])
        with Link(ANYWHERE, there) as gateway:
            until_served(node, lambda: subscribe(gateway), lambda: node._subscriptions.topics)
        monkeypatch.setattr(address_validation, "VALIDATION_NANOS", 0)
        node.turn(0)
        assert node._subscriptions.topics == []


def test_reachable_socket_requires_a_sender_rule(ros: Ros) -> None:
    with pytest.raises(ValueError, match="--allow-any-peer"), ended(ros, bind="0.0.0.0:0"):
        pass


def until_published(ros: Ros, topic: str, again: Callable[[], object]) -> None:
    def has_publisher() -> bool:
        again()
        return topic in ros.published

    wait_until(has_publisher, f"{topic} is published")


def test_bogus_topics_give_their_places_back(ros: Ros, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(publish_queue, "IDLE_S", 0.3)
    with ended(ros) as node, attackers(node, 2) as (hostile, live):
        for number in range(publish_queue.MAX_TOPICS):
            hostile.send(datagram(TWIST, f"/bogus/{number}", BODY))
        wait_until(lambda: len(ros.published) == publish_queue.MAX_TOPICS, "no place is free")
        until_published(ros, "/real", lambda: live.send(datagram(TWIST, "/real", BODY)))
        assert len(ros.published) <= publish_queue.MAX_TOPICS
        assert node.link.counters()["refused"] == {}


def test_a_known_sender_is_never_locked_out_by_forged_addresses(
    ros: Ros, other_hosts: None
) -> None:
    with ended(ros, **OPEN) as node:
        there = ("127.0.0.1", node.link.address[1])
        with Link(ANYWHERE, there) as gateway, attackers(node) as (hostile,):
            for number in range(publish_queue.MAX_TOPICS):
                hostile.send(datagram(TWIST, f"/bogus/{number}", BODY))
            wait_until(lambda: len(ros.published) == publish_queue.MAX_TOPICS, "no place is free")

            def again() -> None:
                subscribe(gateway)
                gateway.send(TWIST, "/real", "", 1, BODY)

            until_published(ros, "/real", again)
            for number in range(100):
                hostile.send(datagram(TWIST, f"/more/{number}", BODY))
            hostile.send(datagram(TWIST, "/bogus/255", BODY, 1))
            wait_until(lambda: node._queue.refused >= 100, "strangers are refused")
            assert "/real" in ros.published


def test_bogus_subscriptions_give_their_places_back(
    ros: Ros, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(subscriptions, "IDLE_S", 0.3)
    wanted = Subscribe(TWIST).pack()  # until unsubscribed
    with ended(ros) as node, attackers(node, 2) as (hostile, live):
        for number in range(subscriptions.MAX_SUBSCRIPTIONS):
            hostile.send(datagram(SUBSCRIBE, f"/bogus/{number}", wanted))
        wait_until(
            lambda: (node.turn(time.monotonic_ns()), len(node._subscriptions.topics))[1] == 64,
            "all taken",
        )
        until_served(
            *(node, lambda: live.send(datagram(SUBSCRIBE, "/cmd_vel", wanted))),
            lambda: (TWIST, "/cmd_vel") in node._subscriptions.topics,
        )
        assert len(node._subscriptions.topics) == subscriptions.MAX_SUBSCRIPTIONS


def test_barriers_of_unknown_senders_do_not_lock_a_gateway_out(
    ros: Ros, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(lockstep, "SILENT_S", 0.3)
    caplog.set_level(logging.INFO)
    barrier = datagram(CONTROL, "", Barrier(1, -1, 100).pack())
    with ended(ros) as node, attackers(node, 5) as (*hostile, live):
        for one in hostile:
            one.send(barrier)

        def is_served() -> bool:
            live.send(barrier)
            live.listen(0.05)
            return bool(live.drawn)

        wait_until(is_served, "a BarrierReply")


def test_a_barrier_of_three_kilobytes_freezes_nothing(ros: Ros) -> None:
    sent = tuple(SentMessages(TWIST, f"/{number}", 0, 0xFFFF) for number in range(255))
    with ended(ros) as node, attackers(node) as (one,):
        for tick in range(100):
            one.send(datagram(CONTROL, "", Barrier(1, tick, 100, sent).pack()))
        one.send(datagram(CONTROL, "", CreditRequest().pack()))
        began_s = time.process_time()
        wait_until(lambda: (one.listen(0.05), len(one.drawn) > 100)[1], "an answer to each")
        # Counted one by one, a single Barrier took 3 s of processor time.
        assert time.process_time() - began_s < 3.0


def test_names_forge_no_line_of_the_log(ros: Ros, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    with ended(ros) as node, attackers(node) as (one,):
        one.send(datagram(TWIST, "/a\n[ERROR] all is lost\x1b[2K", BODY))
        one.send(Header(TWIST, 0, 0, 1, 1, 0, "/b", "frame\n[ERROR] all is lost").pack() + BODY)
        one.send(datagram(SUBSCRIBE, "/c\r\n[ERROR] all is lost", Subscribe(TWIST).pack()))
        wait_until(
            lambda: (node.turn(0), len(ros.published), len(ros.subscribed))[1:] == (2, 1), "all"
        )
    assert len([line for line in caplog.messages if "all is lost" in line]) >= 3
    assert all(line.isprintable() for line in caplog.messages)
