# SPDX-License-Identifier: Apache-2.0
"""Credits are kept while nobody waits for one, and none of them is lost or taken by mistake."""

import random
import socket
import threading
import time
from collections.abc import Iterator

import pytest

from udp_bridge import Link, Message
from udp_bridge.io.credit_mailbox import CreditMailbox
from udp_bridge.io.native import batch_io
from udp_bridge.io.socket_wrappers import PeerFilter
from udp_bridge.io.udp_socket import UdpSocket
from udp_bridge.receiver.receive_slots import NO_SLOTS, CreditState, PartBatch
from udp_bridge.sender.send_queue import SendQueue
from udp_bridge.wire.control import Credit, CreditRequest
from udp_bridge.wire.header import Header, parse
from udp_bridge.wire.message import DatagramKey
from udp_bridge.wire.types import CONTROL

LOCAL = ("127.0.0.1", 0)
TO = ("127.0.0.1", 9)
TIMEOUT_S = 10.0
BODY = random.Random(5).randbytes(3_000_000)
needs_many = pytest.mark.skipif(batch_io is None, reason="the C extension was not built")


def credit(number: int, part: int = 3, *, topic: str = "/image", msg_type: int = 33) -> bytes:
    header = Header(CONTROL, number + 7, 0, 1, 5 + number, 6, topic)
    return header.pack() + Credit(msg_type, part, number, 4 << 20).pack()


@pytest.fixture
def receiver() -> Iterator[UdpSocket]:
    receiver = UdpSocket(LOCAL, receive_buffer=4 << 20, wait_s=0.05)
    yield receiver
    receiver.close()


@pytest.fixture
def peer(stranger: socket.socket) -> socket.socket:
    return stranger


def taken(receiver: UdpSocket | PeerFilter) -> list[PartBatch]:
    """Receive until nothing comes."""
    found = []
    while (run := receiver.receive_batch(NO_SLOTS, CreditState(0, 1 << 20, 0))) is not None:
        found.append(run)
    return found


def strays(found: list[PartBatch]) -> list[bytes]:
    return [run.unmatched for run in found if run.unmatched is not None]


@needs_many
def test_credits_of_the_current_topic_are_kept_and_counted(
    peer: socket.socket, receiver: UdpSocket
) -> None:
    assert receiver.credit_store.keep(peer.getsockname(), credit(0)) == []
    sent = [credit(number) for number in range(5)]
    for raw in sent:
        peer.sendto(raw, receiver.address)
    found = taken(receiver)
    assert strays(found) == []
    assert sum(run.mailbox_credits for run in found) == 5
    assert sum(run.mailbox_bytes for run in found) == sum(map(len, sent))
    kept = [(number, 3, 4 << 20) for number in range(5)]
    assert receiver.credit_store.collect(False) == kept
    assert receiver.credit_store.collect(False) == []
    peer.sendto(sent[0], receiver.address)
    taken(receiver)
    assert receiver.credit_store.keep(peer.getsockname(), credit(0, topic="/other")) == kept[:1]


@needs_many
def test_an_awaited_credit_is_handed_over(peer: socket.socket, receiver: UdpSocket) -> None:
    receiver.credit_store.keep(peer.getsockname(), credit(0))
    receiver.credit_store.collect(True)
    peer.sendto(credit(1), receiver.address)
    assert strays(taken(receiver)) == [credit(1)]
    receiver.credit_store.collect(False)
    peer.sendto(credit(2), receiver.address)
    assert strays(taken(receiver)) == []
    assert receiver.credit_store.collect(True) == [(2, 3, 4 << 20)]


def delegated(queue: SendQueue, receiver: UdpSocket) -> CreditMailbox:
    """Send what fits of a message and leave the rest to the socket."""
    queue.flow.acknowledged(DatagramKey(33, "", 0, 0), receiver.receive_buffer, 0)
    queue.put(Message(33, "/image", "", 5, 0, BODY))
    mailbox = CreditMailbox(
        receiver.credit_store, dict.fromkeys(("sent_messages", "sent_datagrams", "sent_bytes"), 0)
    )
    while queue.take(0, 1 << 20) is not None:
        mailbox.follow(queue, 0)
    mailbox.collect(0, is_awaited=True)
    mailbox.delegate()
    return mailbox


def parts_at(peer: socket.socket) -> list[tuple[int, bytes]]:
    """Return what came so far, part numbers and slices."""
    peer.setblocking(False)
    found = []
    try:
        while True:
            header, offset = parse(memoryview(raw := peer.recv(1 << 16)))
            found.append((header.part_number, raw[offset:]))
    except BlockingIOError:
        return found


@needs_many
def test_a_delegated_send_continues_as_credits_arrive(
    peer: socket.socket, receiver: UdpSocket
) -> None:
    queue = SendQueue(peer.getsockname(), "loopback")
    mailbox = delegated(queue, receiver)
    window = queue.flow.window
    parts = -(-len(BODY) // 65280)
    assert window.room(65280) == 0
    newest = -1
    (flight,) = window.in_flight(33, "/image") or []
    upcoming = first = flight[2]
    runs_over = []
    while upcoming < parts:
        newest += 2  # so many parts are acknowledged, and no more than that many may go
        peer.sendto(credit(0, newest), receiver.address)
        found = taken(receiver)
        assert strays(found) == []
        runs_over += [run.is_delegation_done for run in found]
        came = parts_at(peer)
        assert came == [(n, BODY[n * 65280 : (n + 1) * 65280]) for n, _ in came]
        assert [n for n, _ in came] == list(range(upcoming, min(upcoming + 2, parts)))
        upcoming += len(came)
    assert runs_over == [False] * (len(runs_over) - 1) + [True]
    assert not queue.is_idle  # until it is told
    assert mailbox.collect(9, is_awaited=False)
    assert queue.is_idle
    assert mailbox._sent["sent_messages"] == 1
    assert mailbox._sent["sent_datagrams"] == parts - first
    rows = window.in_flight(33, "/image") or []
    assert [row[:3] for row in rows] == [(0, newest + 1, parts - newest - 1)]


@needs_many
@pytest.mark.parametrize("wrong", [(1, 3, 4 << 20), (0, 200, 4 << 20), (0, 3, 1 << 20)])
def test_credits_that_make_no_room_for_a_delegated_send_are_handed_over(
    peer: socket.socket, receiver: UdpSocket, wrong: tuple[int, int, int]
) -> None:
    queue = SendQueue(peer.getsockname(), "loopback")
    mailbox = delegated(queue, receiver)
    number, part, buffer = wrong
    header = Header(CONTROL, 1, 0, 1, 5, 6, "/image").pack()
    raw = header + Credit(33, part, number, buffer).pack()
    peer.sendto(raw, receiver.address)
    assert strays(taken(receiver)) == [raw]
    assert parts_at(peer) == []
    assert not mailbox.collect(0, is_awaited=True)
    peer.sendto(credit(0), receiver.address)  # taken back, it is held no more
    assert strays(taken(receiver)) == [credit(0)]
    assert parts_at(peer) == []


@needs_many
def test_credits_beyond_the_mailbox_are_handed_over(
    peer: socket.socket, receiver: UdpSocket
) -> None:
    receiver.credit_store.keep(peer.getsockname(), credit(0))
    for number in range(70):
        peer.sendto(credit(number), receiver.address)
    found = taken(receiver)
    assert strays(found) == [credit(number) for number in range(64, 70)]
    assert (
        len(receiver.credit_store.collect(False)) == sum(run.mailbox_credits for run in found) == 64
    )


def flipped(raw: bytes, at: int) -> bytes:
    return raw[:at] + bytes((raw[at] ^ 0x81,)) + raw[at + 1 :]


FREE = {2, 3, 4, 5, 8, 9, 10, 11, 12, 13, 14}
"""Bytes of a Credit's header that may be anything: its number, and all but the top of its time."""
FREE_OF_BODY = {2, 3, 4, 5, 6, 7, 8, 9, 10, 11}


@needs_many
def test_what_is_no_such_credit_is_handed_over(peer: socket.socket, receiver: UdpSocket) -> None:
    receiver.credit_store.keep(peer.getsockname(), credit(0))
    right = credit(1)
    body_at = len(right) - 12
    fixed = [
        at
        for at in range(len(right))
        if at not in FREE and not (at >= body_at and at - body_at in FREE_OF_BODY)
    ]
    wrong = [flipped(right, at) for at in fixed]
    wrong += [right[:-1], right + b"\0", b"", credit(1, topic="/images"), credit(1, msg_type=1)]
    wrong.append(Header(CONTROL, 1, 0, 1, 5, 6, "/image").pack() + CreditRequest().pack())
    wrong += [random.Random(1).randbytes(size) for size in (10, 300, 65507)]
    for raw in wrong:
        peer.sendto(raw, receiver.address)
    assert strays(taken(receiver)) == wrong
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.sendto(right, receiver.address)
        assert strays(taken(receiver)) == [right]
    assert receiver.credit_store.collect(False) == []


@needs_many
def test_credits_of_strangers_are_refused(peer: socket.socket, receiver: UdpSocket) -> None:
    around = PeerFilter(receiver, [TO])
    around.credit_store.keep(peer.getsockname(), credit(0))
    peer.sendto(credit(1), receiver.address)
    assert [run.refused for run in taken(around)] == ["stranger"]
    assert around.credit_store.collect(False) == []


class FakeStore:
    """A socket that keeps what it is given."""

    def __init__(self) -> None:
        self.kept: list[tuple[int, int, int]] = []
        self.like: list[bytes] = []
        self.is_awaited = False

    def keep(self, to: tuple[str, int], like: bytes) -> list[tuple[int, int, int]]:
        self.like.append(like)
        return self.collect(self.is_awaited)

    def collect(self, is_awaited: bool) -> list[tuple[int, int, int]]:
        self.is_awaited = is_awaited
        kept, self.kept = self.kept, []
        return kept


def outbox_with(*topics: str) -> SendQueue:
    queue = SendQueue(TO, "loopback")
    queue.flow.acknowledged(DatagramKey(33, "", 0, 0), 8 << 20, 0)
    for topic in topics:
        queue.put(Message(33, topic, "", 5, 0, bytes(3_000_000)))
    return queue


def test_kept_credits_make_room() -> None:
    store = FakeStore()
    mailbox = CreditMailbox(store, {})
    queue = outbox_with("/image", "/other")
    assert not mailbox.collect(0, is_awaited=True)  # nothing was sent yet
    while (datagram := queue.take(0, 1 << 20)) is not None:
        assert datagram.batch is not None
        mailbox.follow(queue, 0)
    assert [like[18:24] for like in store.like] == [b"/image", b"/other"]
    assert not queue.is_idle
    assert not mailbox.collect(0, is_awaited=True)
    assert store.is_awaited
    before = queue.flow.window.in_flight_bytes
    store.kept = [(0, 3, 8 << 20)]
    assert mailbox.collect(0, is_awaited=False)
    assert not store.is_awaited
    assert queue.flow.window.in_flight_bytes < before


def test_nothing_is_awaited_when_nothing_waits() -> None:
    store = FakeStore()
    mailbox = CreditMailbox(store, {})
    queue = outbox_with("/image")
    while queue.take(0, 1 << 22) is not None:
        mailbox.follow(queue, 0)
    assert queue.is_idle
    mailbox.collect(0, is_awaited=True)
    assert not store.is_awaited


def test_a_stream_of_many_threads_and_topics_never_waits_in_vain() -> None:
    count, topics = 150, ("/a", "/b", "/c")
    came: list[tuple[str, int]] = []
    is_whole = threading.Event()
    bodies = {topic: random.Random(topic).randbytes(1_500_000) for topic in topics}

    def on_message(message: Message, _: object) -> None:
        assert message.body == bodies[message.topic]
        came.append((message.topic, message.seq_number))
        if len(came) == count * len(topics):
            is_whole.set()

    waiting = {(33, topic): 1 << 30 for topic in topics}
    with (
        Link(LOCAL, on_message=on_message) as receiver,
        Link(LOCAL, receiver.address, queue_limits=waiting) as link,
    ):

        def send(topic: str) -> None:
            rng = random.Random(topic)
            for _ in range(count):
                link.send(33, topic, "", time.time_ns(), bodies[topic])
                if rng.random() < 0.5:
                    link.flush(TIMEOUT_S)

        threads = [threading.Thread(target=send, args=(topic,)) for topic in topics]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert is_whole.wait(TIMEOUT_S)
        assert link.flush(TIMEOUT_S)
        assert link.counters()["superseded"] == 0
    for topic in topics:
        assert [number for name, number in came if name == topic] == list(range(count))
