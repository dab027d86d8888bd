# SPDX-License-Identifier: Apache-2.0
import socket

import pytest

from groundlink.core.errors import UserError
from services.sensors.runtime.model import Datagram, RemovedSensor
from services.sensors.runtime.process import NativeLink


class Device:
    """Sends its readings as they are."""

    def datagrams(self, reading: list[Datagram], epoch_nanos: int) -> list[Datagram]:
        assert epoch_nanos == 7
        return reading


def test_datagrams_go_out_in_order_and_are_counted() -> None:
    with socket.socket(type=socket.SOCK_DGRAM) as one, socket.socket(type=socket.SOCK_DGRAM) as two:
        for receiver in (one, two):
            receiver.bind(("127.0.0.1", 0))
            receiver.settimeout(5)
        own_port = two.getsockname()[1]
        link = NativeLink(Device(), f"127.0.0.1:{one.getsockname()[1]}")
        link.send([Datagram(b"one"), Datagram(b"its own", own_port), Datagram(b"two")], 7)
        assert [one.recv(10), one.recv(10), two.recv(10)] == [b"one", b"two", b"its own"]
        link.send([Datagram(bytes(70_000)), Datagram(b"three")], 7)  # Too large for any datagram.
        assert one.recv(10) == b"three"
    link.close()
    assert link.counters == {"native": 4, "native_unsent": 1}


def test_datagrams_come_from_the_port_of_the_device() -> None:
    with socket.socket(type=socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(5)
        with socket.socket(type=socket.SOCK_DGRAM) as free:
            free.bind(("", 0))
            port = free.getsockname()[1]

        class Bound(Device):
            source_port = port

        links = [NativeLink(Bound(), f"127.0.0.1:{receiver.getsockname()[1]}") for _ in range(2)]
        for link in links:
            link.send([Datagram(b"one")], 7)
            assert receiver.recvfrom(10) == (b"one", ("127.0.0.1", port))
            link.close()


def test_a_device_that_uses_its_model_gets_that_of_a_changed_world() -> None:
    class Follower(Device):
        def follow(self, model: object) -> None:
            self.model = model

    follower, model = Follower(), RemovedSensor()
    for device in (follower, Device()):
        link = NativeLink(device, "127.0.0.1:9")
        link.follow(model)
        link.close()
    assert follower.model is model


def test_a_destination_without_a_port_is_refused() -> None:
    with pytest.raises(UserError, match="nowhere"):
        NativeLink(Device(), "nowhere")
