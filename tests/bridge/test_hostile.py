# SPDX-License-Identifier: Apache-2.0
"""Garbage between the datagrams of a real link, from the sender's address."""

import random
from collections.abc import Sequence

from tests.ros.waiting import wait_until
from udp_bridge import Link, Message
from udp_bridge.io.socket_wrappers import SocketWrapper
from udp_bridge.io.udp_socket import UdpSocket
from udp_bridge.wire.header import Buffer
from udp_bridge.wire.message import Address

MESSAGES = 60


class GarbageSender(SocketWrapper):
    """Sends a broken copy or random bytes after each datagram."""

    def __init__(self) -> None:
        super().__init__(UdpSocket(("127.0.0.1", 0), receive_buffer=1 << 20, wait_s=0.1))
        self._rng = random.Random(1)

    def send(self, buffers: Sequence[Buffer], to: Address) -> bool:
        is_sent = super().send(buffers, to)
        broken = bytearray(b"".join(bytes(part) for part in buffers))
        kind = self._rng.randrange(4)
        if kind == 0:
            # Another type or size: with these fields it cannot pass as a part of this message.
            broken[self._rng.choice([0, 1, 16, 17])] = self._rng.randrange(256)
        elif kind == 1:
            del broken[self._rng.randrange(len(broken)) :]
        elif kind == 2:
            broken[-1] ^= 0xFF
        else:
            broken[:] = self._rng.randbytes(self._rng.randrange(100))
        super().send([bytes(broken)], to)
        return is_sent


def test_garbage_changes_no_body_and_ends_nothing() -> None:
    received: dict[int, bytes] = {}

    def on_message(message: Message, _: Address) -> None:
        if (message.msg_type, message.topic) == (1, "/points"):
            received[message.stamp_nanos] = bytes(message.body)

    rng = random.Random(2)
    sent = {stamp: rng.randbytes(rng.choice([10, 30_000, 300_000])) for stamp in range(MESSAGES)}
    with (
        Link(("127.0.0.1", 0), on_message=on_message) as receiver,
        Link(("", 0), receiver.address, datagram="mtu", socket=GarbageSender()) as sender,
    ):
        for stamp, body in sent.items():
            sender.send(1, "/points", "lidar", stamp, body)
            wait_until(lambda stamp=stamp: stamp in received, f"message {stamp}")
        counters = receiver.counters()
    assert received == sent
    assert sum(counters["refused"].values()) > MESSAGES
    assert counters["duplicates"] > MESSAGES
