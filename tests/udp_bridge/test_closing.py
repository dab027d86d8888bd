# SPDX-License-Identifier: Apache-2.0
"""What an ended link leaves behind: no buffers, nothing that waits for the garbage collector."""

import gc
import threading
import time
import weakref
from collections.abc import Iterator

import pytest

from udp_bridge import Link, Message

LOCAL = ("127.0.0.1", 0)
BODY = bytes(300_000)


@pytest.fixture
def without_collector() -> Iterator[None]:
    gc.collect()
    gc.disable()
    yield
    gc.enable()


def carried() -> tuple[Link, Link, list[Message]]:
    """Return a receiver and a sender that have carried large and small messages, and these."""
    came: list[Message] = []
    is_enough = threading.Event()

    def take(message: Message, _: object) -> None:
        if message.topic in ("/a", "/b"):
            came.append(message)
        if len(came) == 2:
            is_enough.set()

    receiver = Link(LOCAL, on_message=take, report=True)
    sender = Link(LOCAL, receiver.address)
    for topic, body in (("/a", BODY), ("/b", BODY[:100])):
        sender.send(1, topic, "", time.time_ns(), body)
    assert is_enough.wait(5)
    return receiver, sender, came


@pytest.mark.usefixtures("without_collector")
def test_an_ended_link_is_gone_at_once() -> None:
    receiver, sender, _ = carried()
    gone = [
        weakref.ref(part)
        for link in (receiver, sender)
        for part in (link, link._inbox, link._inbox.reassembler, link._socket)
    ]
    sender.close()
    receiver.close()
    del receiver, sender
    assert [ref() for ref in gone] == [None] * len(gone)


def test_an_ended_link_that_is_kept_keeps_counters_but_no_buffers() -> None:
    receiver, sender, came = carried()
    assert receiver._inbox.reassembler.pool.kept_bytes >= len(BODY)
    sender.close()
    receiver.close()
    assert receiver._inbox.reassembler.pool.kept_bytes == 0
    assert receiver.counters()["messages"] >= 2
    assert sorted(len(message.body) for message in came) == [100, 300_000]
    assert all(not any(message.body) for message in came), "what was handed over stays"
