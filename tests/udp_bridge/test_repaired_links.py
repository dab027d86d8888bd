# SPDX-License-Identifier: Apache-2.0
"""Repair between two links over real sockets; datagrams are lost on purpose, by a seed."""

import random
import time
from typing import Any, cast

import pytest

from tests.ros.waiting import wait_until
from tests.udp_bridge.io.test_link import DEFAULT_BUFFER, LOCAL
from udp_bridge import Link, Message
from udp_bridge.io.udp_socket import DatagramSocket, UdpSocket
from udp_bridge.sender.repair import Fec, Mode, Resend
from udp_bridge.wire.header import Header
from udp_bridge.wire.repair import Offer
from udp_bridge.wire.types import CONTROL, RESEND


def lossy(rng: random.Random, share: float) -> DatagramSocket:
    """Return a socket of the kind below, as what it stands for."""
    return cast(DatagramSocket, Lossy(rng, share))


class Lossy:
    """A socket that loses some of what it receives; it offers no runs."""

    def __init__(self, rng: random.Random, share: float) -> None:
        self._inner = UdpSocket(LOCAL, receive_buffer=4 << 20, wait_s=0.02)
        self._rng, self._share = rng, share
        self.lost = 0

    def receive_into(self, buffer: bytearray) -> tuple[int, tuple[str, int]] | None:
        received = self._inner.receive_into(buffer)
        if received is not None and self._rng.random() < self._share:
            self.lost += 1
            return None
        return received

    def __getattr__(self, name: str) -> Any:
        if name in ("receive_batch", "send_batch"):
            raise AttributeError(name)
        return getattr(self._inner, name)


@pytest.mark.parametrize("mode", [Resend(2_000_000_000), Fec(0.3)])
def test_what_is_lost_between_two_links_is_mended(mode: Mode) -> None:
    count = 40
    bodies = [random.Random(index).randbytes(90_000) for index in range(count)]
    received: list[Message] = []
    seeds = random.Random(8)
    at_receiver, at_sender = Lossy(seeds, 0.05), Lossy(seeds, 0.05)
    table = {(1, "/points"): mode}
    with (
        Link(
            LOCAL,
            on_message=lambda message, _: received.append(message),
            socket=cast(DatagramSocket, at_receiver),
        ) as to,
        Link(
            LOCAL, to.address, datagram=1472, repair=table, socket=cast(DatagramSocket, at_sender)
        ) as link,
    ):
        for index, body in enumerate(bodies):
            before = len(received)
            link.send(1, "/points", "lidar", time.time_ns(), body)
            wait_until(lambda before=before: len(received) > before)  # type: ignore[misc]
            assert received[-1].seq_number == index
        assert link.flush(20)
        sent, got = link.counters(), to.counters()
    assert [bytes(message.body) for message in received] == bodies
    assert at_receiver.lost > 20
    assert got["repaired"] > count // 2
    assert got["refused"] == {}
    assert (sent["resent"] > 0) == (got["resend_requests"] > 0) == isinstance(mode, Resend)


def test_a_body_may_be_sent_to_a_link_that_offers_no_repair() -> None:
    received: list[Message] = []
    with (
        Link(LOCAL, on_message=lambda message, _: received.append(message)) as to,
        Link(LOCAL, to.address, receive_buffer=DEFAULT_BUFFER) as link,
    ):
        link.send(1, "/points", "", 1, bytes(100_000))
        wait_until(lambda: len(received) == 1)
        assert to.counters()["resend_requests"] == 0


def test_a_topic_may_be_mended_from_some_message_on() -> None:
    count = 200
    received: set[int] = set()
    lossy_socket = Lossy(random.Random(4), 0.2)
    with (
        Link(
            LOCAL,
            on_message=lambda message, _: received.add(message.seq_number),
            socket=cast(DatagramSocket, lossy_socket),
        ) as to,
        Link(LOCAL, to.address) as link,
    ):
        assert link.sent_counts() == {}
        for index in range(2 * count):
            if index == count:
                link.enable_repair(9, "/cmd_vel", Resend(5_000_000_000))
            link.send(9, "/cmd_vel", "", time.time_ns(), bytes(52))
        assert link.flush(20)
        assert link.sent_counts() == {(9, "/cmd_vel"): 2 * count}
        wait_until(lambda: received >= set(range(count, 2 * count)))
    assert not received >= set(range(count))


def test_missed_states_are_requested_before_later_acks() -> None:
    offer = Header(RESEND, 0, 0, 1, 1, 0, "/p").pack() + Offer(1, 4, 2000).pack()
    parts = [
        Header(1, seq_number, number, 4, 1, seq_number, "/p").pack() + bytes(1000)
        for seq_number in range(2)
        for number in range(4)
    ]
    came = []
    buffer = bytearray(1 << 16)
    with Link(LOCAL, socket=lossy(random.Random(1), 0.0)) as to:
        source = UdpSocket(LOCAL, receive_buffer=1 << 20, wait_s=5.0)
        for datagram in [*parts[:4], offer, parts[4], parts[6]]:
            source.send([datagram], to.address)
        wait_until(lambda: to.counters()["received_datagrams"] == 7)
        old_nanos = time.monotonic_ns() + 2_000_000
        wait_until(lambda: time.monotonic_ns() > old_nanos)  # now the gap is worth a request
        source.send([parts[7]], to.address)
        for _ in range(3):
            assert source.receive_into(buffer) is not None
            came.append(buffer[0])
        source.shut()
        source.close()
    assert came == [CONTROL, RESEND, CONTROL]
