# SPDX-License-Identifier: Apache-2.0
"""A program that knows PROTOCOL.md alone subscribes at a gateway's socket, and ends it again."""

import socket
import threading
from collections.abc import Iterator
from itertools import count
from typing import Any

import pytest

from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.messages.base import Imu
from services.gateway.gateway import Gateway
from udp_bridge import Header, Link, Message
from udp_bridge.wire.control import Subscribe
from udp_bridge.wire.types import SUBSCRIBE, type_number

RUN = "lab"
IMU = type_number("Imu")
PERIOD_NANOS = 10_000_000


class Subscriber:
    """A bare socket, and a gateway with no bus behind it."""

    def __init__(self) -> None:
        self.socket, self._peer = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in "ab")
        for end in (self.socket, self._peer):
            end.bind(("127.0.0.1", 0))
            end.setblocking(False)
        self._gateway = Gateway(
            load(SHIPPED / "indoor_lab.yaml"),
            RUN,
            peer=self._peer.getsockname(),
            publish=lambda key, message: None,
        )
        self._taken = threading.Event()
        self.link = Link(("127.0.0.1", 0), on_message=self._take)
        self._stamps, self._numbers = count(10**9, PERIOD_NANOS), count()

    def _take(self, message: Message, sender: Any) -> None:
        self._gateway.on_message(message, sender)
        self._taken.set()

    def subscribe(self, body: Subscribe) -> None:
        head = Header(SUBSCRIBE, next(self._numbers), 0, 1, 1, 0, "/imu").pack()
        self._taken.clear()
        self.socket.sendto(head + body.pack(), self.link.address)
        assert self._taken.wait(20)

    def received_of(self, messages: int) -> int:
        """Let so many samples leave the gateway; return how many came, which loopback keeps."""
        for _ in range(messages):
            sample = Imu(next(self._stamps), "imu", (0, 0, 0, 1), (0, 0, 0), (0, 0, 0), 1, 1, 1)
            self._gateway.forward(f"groundlink/{RUN}/rover/imu", sample, self.link)
        assert self.link.flush(20)
        return len(self._datagrams())

    def _datagrams(self) -> list[bytes]:
        found = []
        while True:
            try:
                found.append(self.socket.recv(65536))
            except BlockingIOError:
                return found

    def close(self) -> None:
        self.link.close()
        self.socket.close()
        self._peer.close()


@pytest.fixture
def subscriber() -> Iterator[Subscriber]:
    found = Subscriber()
    yield found
    found.close()


def test_an_unlimited_subscription_ends(subscriber: Subscriber) -> None:
    assert subscriber.received_of(100) == 0
    subscriber.subscribe(Subscribe(IMU))
    assert subscriber.received_of(100) == 100
    subscriber.subscribe(Subscribe(IMU, action=0))
    assert subscriber.received_of(100) == 0


def test_a_rate_replaces_an_unlimited_subscription(subscriber: Subscriber) -> None:
    subscriber.subscribe(Subscribe(IMU))
    assert subscriber.received_of(100) == 100
    subscriber.subscribe(Subscribe(IMU, max_rate_hz=5.0))
    assert subscriber.received_of(100) == 5
