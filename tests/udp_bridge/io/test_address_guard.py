# SPDX-License-Identifier: Apache-2.0
"""What a socket takes and sends behind each guard; `tests/bridge/test_attacks.py` attacks them."""

import random

import pytest

from tests.ros.waiting import wait_until
from udp_bridge import Link, Message
from udp_bridge.io import address_guard
from udp_bridge.io.address_guard import AddressGuard, Unguarded, open_socket
from udp_bridge.io.socket_wrappers import PeerFilter, SealedSocket
from udp_bridge.io.udp_socket import UdpSocket
from udp_bridge.wire import address_validation
from udp_bridge.wire.message import Address
from udp_bridge.wire.seal import FROM_ROS

LOCAL, EVERYWHERE = ("127.0.0.1", 0), ("0.0.0.0", 0)
SECRET = bytes(16)


@pytest.fixture
def other_hosts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let loopback addresses be those of other hosts."""
    for module in (address_validation, address_guard):
        monkeypatch.setattr(module, "is_local", lambda _: False)


def kind(
    bind: Address, peer: Address | None, secret: bytes | None, allow_any_peer: bool
) -> list[type]:
    socket = open_socket(
        bind, peer=peer, secret=secret, sends=FROM_ROS, allow_any_peer=allow_any_peer
    )
    socket.close()
    found = [type(socket)]
    while hasattr(socket, "_inner"):
        socket = socket._inner
        found.append(type(socket))
    return found


@pytest.mark.parametrize(
    ("bind", "peer", "secret", "allowed", "kinds"),
    [
        (LOCAL, None, None, False, [UdpSocket]),
        (LOCAL, LOCAL, None, False, [PeerFilter, UdpSocket]),
        (EVERYWHERE, LOCAL, None, False, [PeerFilter, UdpSocket]),
        (EVERYWHERE, None, SECRET, False, [SealedSocket, UdpSocket]),
        (EVERYWHERE, LOCAL, SECRET, False, [SealedSocket, PeerFilter, UdpSocket]),
        (EVERYWHERE, None, None, True, [AddressGuard, UdpSocket]),
        (LOCAL, None, None, True, [UdpSocket]),
    ],
)
def test_the_guard_is_the_configured_one(
    bind: Address, peer: Address | None, secret: bytes | None, allowed: bool, kinds: list[type]
) -> None:
    assert kind(bind, peer, secret, allowed) == kinds


def test_without_any_a_socket_that_others_reach_is_not_opened() -> None:
    with pytest.raises(Unguarded, match=r"bind 0\.0\.0\.0:0: .* Fix: --peer HOST:PORT, --key-file"):
        open_socket(EVERYWHERE, sends=FROM_ROS)


def test_a_link_with_a_peer_takes_from_it_and_from_where_it_sends() -> None:
    received: list[bytes] = []
    with Link(LOCAL) as peer, Link(LOCAL) as other, Link(LOCAL) as stranger:
        with Link(
            LOCAL, peer.address, on_message=lambda got, _: received.append(bytes(got.body))
        ) as link:
            stranger.send(2, "/imu", "", 1, b"stranger", link.address)
            wait_until(lambda: link.received.refused == {"stranger": 1}, "the refusal")
            link.send(2, "/imu", "", 1, b"", other.address)
            for one, body in ((other, b"other"), (peer, b"peer")):
                one.send(2, "/imu", "", 1, body, link.address)
            wait_until(lambda: sorted(received) == [b"other", b"peer"], "both messages")


def test_large_messages_pass_a_guard_without_validated_addresses(other_hosts: None) -> None:
    received: list[Message] = []
    rng = random.Random(1)
    bodies = [rng.randbytes(300_000) for _ in range(20)]
    with Link(EVERYWHERE, on_message=lambda got, _: received.append(got)) as receiver:
        assert isinstance(receiver._socket, AddressGuard)
        there = ("127.0.0.1", receiver.address[1])
        with Link(LOCAL, there, datagram="mtu") as sender:
            for stamp, body in enumerate(bodies):
                sender.send(1, "/points", "", stamp, body)
                assert sender.flush(20)
            wait_until(lambda: len(received) == len(bodies), "all messages")
            assert sender._queues[sender._queue_for(there).to].flow.is_window_in_use
        counters = receiver.counters()
        assert 0 < counters["sent_bytes"] < counters["received_bytes"]
    assert [bytes(message.body) for message in received] == bodies


def test_a_link_sends_to_whom_its_user_names(other_hosts: None) -> None:
    received: list[Message] = []
    with (
        Link(LOCAL, on_message=lambda got, _: received.append(got)) as receiver,
        Link(EVERYWHERE) as sender,
    ):
        sender.send(2, "/imu", "", 1, b"body", receiver.address)
        wait_until(lambda: bool(received), "the message")
