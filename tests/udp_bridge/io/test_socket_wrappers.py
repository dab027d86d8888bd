# SPDX-License-Identifier: Apache-2.0
"""Links over sealed and guarded sockets: real sockets on loopback, waiting for conditions."""

import socket
import threading
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import pytest

from tests.ros.waiting import wait_until
from udp_bridge import Link, Message, fragments
from udp_bridge.io.native import batch_io
from udp_bridge.io.socket_wrappers import PeerFilter, SealedSocket
from udp_bridge.io.udp_socket import DatagramSocket, UdpSocket
from udp_bridge.wire.fragments import LARGEST_DATAGRAM, MTU_DATAGRAM, DatagramSize
from udp_bridge.wire.seal import FROM_ROS, TO_ROS

LOCAL = ("127.0.0.1", 0)
SECRET = b"0123456789abcdef"
TIMEOUT_S = 20.0


class Tap(UdpSocket):
    """Notes what goes out."""

    def __init__(self) -> None:
        super().__init__(LOCAL, receive_buffer=4 << 20, wait_s=0.05)
        self.sent: list[bytes] = []

    def send(self, buffers: Any, to: tuple[str, int]) -> bool:
        self.sent.append(b"".join(buffers))
        return super().send(buffers, to)


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack
    assert not [t for t in threading.enumerate() if t.name.startswith("udp_bridge")]


def end(stack: ExitStack, around: DatagramSocket, **options: Any) -> tuple[Link, list[Message]]:
    received: list[Message] = []
    link = Link(
        LOCAL, socket=around, on_message=lambda message, _: received.append(message), **options
    )
    return stack.enter_context(link), received


@pytest.mark.parametrize("datagram", ["mtu", "loopback", 256, 65507])
def test_sealed_links_understand_each_other_at_every_size(
    stack: ExitStack, datagram: DatagramSize
) -> None:
    ros, received = end(stack, SealedSocket(Tap(), SECRET, sends=FROM_ROS))
    tap = Tap()
    gateway, _ = end(
        stack, SealedSocket(tap, SECRET, sends=TO_ROS), peer=ros.address, datagram=datagram
    )
    body = bytes(range(256)) * 1000
    topic, frame = "/" + "t" * 200, "f" * 33  # the largest header there is
    gateway.send(1, topic, frame, 1, body)
    gateway.send(8, "/clock", "", 1, b"clock")
    wait_until(lambda: len(received) == 2)
    assert [m.body for m in received if m.msg_type == 1] == [body]
    most = {"mtu": MTU_DATAGRAM, "loopback": LARGEST_DATAGRAM}.get(str(datagram), datagram)
    assert max(map(len, tap.sent)) <= (LARGEST_DATAGRAM if datagram == 256 else int(most))
    if datagram == "mtu":
        assert max(map(len, tap.sent)) == MTU_DATAGRAM
    assert {datagram[0] for datagram in tap.sent} == {68}
    wait_until(lambda: gateway.received.messages > 0)  # credits come back sealed
    assert ros.counters()["refused"] == gateway.counters()["refused"] == {}


def test_what_is_not_sealed_for_us_is_counted_and_changes_nothing(
    stack: ExitStack, stranger: socket.socket
) -> None:
    ros, received = end(stack, SealedSocket(Tap(), SECRET, sends=FROM_ROS))
    plain = stack.enter_context(Link(LOCAL, ros.address))
    plain.send(9, "/cmd_vel", "", 1, b"twist")
    wait_until(lambda: ros.counters()["refused"] == {"unsealed": 1})
    other, _ = end(stack, SealedSocket(Tap(), SECRET * 2, sends=TO_ROS), peer=ros.address)
    other.send(9, "/cmd_vel", "", 1, b"twist")
    wait_until(lambda: ros.counters()["refused"] == {"unsealed": 1, "bad_tag": 1})
    tap = Tap()
    gateway, _ = end(stack, SealedSocket(tap, SECRET, sends=TO_ROS), peer=ros.address)
    gateway.send(9, "/cmd_vel", "", 1, b"twist")
    wait_until(lambda: len(received) == 1)
    stranger.sendto(tap.sent[0], ros.address)  # from another address, too
    stranger.sendto(tap.sent[0], gateway.address)
    refused = {"unsealed": 1, "bad_tag": 1, "replayed": 1}
    wait_until(lambda: ros.counters()["refused"] == refused)
    wait_until(lambda: gateway.counters()["refused"] == {"reflected": 1})
    assert [message.body for message in received] == [b"twist"]
    assert ros.counters()["received_datagrams"] == 4


def test_link_without_key_reports_sealed_datagrams(stack: ExitStack) -> None:
    plain = stack.enter_context(Link(LOCAL))
    gateway, _ = end(stack, SealedSocket(Tap(), SECRET, sends=TO_ROS), peer=plain.address)
    gateway.send(9, "/cmd_vel", "", 1, b"twist")
    wait_until(lambda: plain.counters()["refused"] == {"sealed": 1})


def test_a_restarted_sender_is_understood(stack: ExitStack) -> None:
    ros, received = end(stack, SealedSocket(Tap(), SECRET, sends=FROM_ROS))
    for restart in range(3):
        gateway, _ = end(stack, SealedSocket(Tap(), SECRET, sends=TO_ROS), peer=ros.address)
        gateway.send(9, "/cmd_vel", "", 1, b"twist")
        wait_until(lambda restart=restart: len(received) == restart + 1)
        gateway.close()
    assert ros.counters()["refused"] == {}


def test_only_peers_are_received(stack: ExitStack) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(LOCAL)
        friend_address = probe.getsockname()
    guarded, received = end(stack, PeerFilter(Tap(), [friend_address, ("127.0.0.2", 0)]))
    stranger = stack.enter_context(Link(LOCAL, guarded.address))
    stranger.send(9, "/cmd_vel", "", 1, b"stranger")
    wait_until(lambda: guarded.counters()["refused"] == {"stranger": 1})
    for bind in (friend_address, ("127.0.0.2", 0), ("127.0.0.2", 0)):
        friend = stack.enter_context(Link(bind, guarded.address))
        friend.send(9, "/cmd_vel", "", 1, b"friend")
    wait_until(lambda: len(received) == 3)
    assert {message.body for message in received} == {b"friend"}


def test_large_messages_of_peers_arrive_in_batches_among_strangers(stack: ExitStack) -> None:
    tap = Tap()
    guarded, received = end(stack, PeerFilter(tap, [("127.0.0.1", 0)]), report=False)
    friend = stack.enter_context(Link(LOCAL, guarded.address))
    stranger = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
    stranger.bind(("127.0.0.2", 0))
    body = bytes(range(256)) * 4000
    parts = [raw + bytes(part) for raw, part in fragments(Message(1, "/points", "", 1, 0, body))]
    for count in range(1, 11):
        stranger.sendto(parts[0], guarded.address)
        friend.send(1, "/points", "", count, body)
        for part in parts[1:]:
            stranger.sendto(part, guarded.address)
        wait_until(lambda count=count: len(received) == count)  # type: ignore[misc]
    wait_until(lambda: guarded.counters()["refused"] == {"stranger": 10 * len(parts)})
    assert all(message.body == body for message in received)
    counters = guarded.counters()
    assert counters["duplicates"] == counters["incomplete"] == 0
    if batch_io:
        assert len(tap.sent) < counters["sent_datagrams"]  # most credits went out beside runs


def test_a_flood_of_strangers_takes_no_memory(stack: ExitStack, stranger: socket.socket) -> None:
    guarded, received = end(stack, PeerFilter(Tap(), [("127.0.0.9", 0)]))
    count = 0
    while guarded.counters()["refused"].get("stranger", 0) < 2000:
        stranger.sendto(bytes(1000), guarded.address)
        count += 1
        assert count < 1_000_000
    assert guarded._inbox.reassembler.counters.refused.keys() == {"stranger"}
    assert not list(guarded._inbox._peers)
    assert not received
