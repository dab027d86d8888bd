# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import socket

import pytest

from groundlink.errors import UserError
from services.sensors.native import NativeLink


def test_datagrams_go_out_in_order_and_are_counted() -> None:
    with socket.socket(type=socket.SOCK_DGRAM) as device:
        device.bind(("127.0.0.1", 0))
        device.settimeout(5)
        link = NativeLink(f"127.0.0.1:{device.getsockname()[1]}")
        link.send([b"one", b"two"])
        assert [device.recv(10), device.recv(10)] == [b"one", b"two"]
        link.send([bytes(70_000), b"three"])  # Too large for any datagram.
        assert device.recv(10) == b"three"
    link.close()
    assert (link.sent, link.unsent) == (3, 1)


def test_a_destination_without_a_port_is_refused() -> None:
    with pytest.raises(UserError, match="nowhere"):
        NativeLink("nowhere")
