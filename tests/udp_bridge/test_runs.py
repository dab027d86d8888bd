# SPDX-License-Identifier: Apache-2.0
"""Many at once and one by one do the same, over real sockets."""

from __future__ import annotations

import random
import socket
from collections.abc import Iterator

import pytest

from udp_bridge import Message, mmsg, runs
from udp_bridge.fragments import Parts, Split
from udp_bridge.placing import Slots
from udp_bridge.sending import Run

LOCAL = ("127.0.0.1", 0)
HEADER = 32
PART = 1000

needs_many = pytest.mark.skipif(not mmsg.AVAILABLE, reason="no recvmmsg here")
RECEIVING = [pytest.param(runs.ManyAtOnce, marks=needs_many), runs.OneByOne]
SENDING = [pytest.param(runs.SendingMany, marks=needs_many), runs.SendingOne]
Pair = tuple[socket.socket, socket.socket]


@pytest.fixture
def pair() -> Iterator[Pair]:
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as two,
    ):
        for end in (one, two):
            end.bind(LOCAL)
        two.settimeout(10.0)
        yield one, two


def parts_of(size: int) -> Parts:
    body = memoryview(random.Random(size).randbytes(size))
    count = -(-size // PART)
    packed = Message(1, "/points", "lidar", 0, 0, b"").header(parts_max=count).pack()
    return Parts(packed, body, Split(PART, count))


@pytest.mark.parametrize("sending", SENDING)
def test_a_run_is_sent_as_its_datagrams(sending: type, pair: Pair) -> None:
    one, two = pair
    sender = sending()
    for size in (2500, 7001, 5000):
        parts = parts_of(size)
        expected = [head + bytes(part) for head, part in parts_of(size)]
        to = two.getsockname()
        middle = parts.cut.parts_max - 1
        for first, count in ((0, middle), (middle, parts.cut.parts_max - middle)):
            assert sender.send(one, Run(parts, first, count), to, lambda _: False) == count
        assert [two.recv(65536) for _ in expected] == expected


@pytest.mark.parametrize("sending", SENDING)
def test_a_datagram_that_can_not_be_sent_is_left_out(sending: type, pair: Pair) -> None:
    complaints: list[int] = []

    def complain(number: int) -> bool:
        complaints.append(number)
        return False

    run = Run(parts_of(2500), 0, 3)
    assert sending().send(pair[0], run, ("255.255.255.255", 9), complain) == 0
    assert len(complaints) == 3


@pytest.mark.parametrize("receiving", RECEIVING)
def test_datagrams_of_any_size_come_back_whole(receiving: type, pair: Pair) -> None:
    one, two = pair
    receiver = receiving()
    rng = random.Random(1)
    sent = [rng.randbytes(size) for size in (0, 10, HEADER, 500, HEADER + PART, 1500, 65507)]
    for raw in sent:
        one.sendto(raw, two.getsockname())
    block = bytearray(16 * PART)
    received: list[bytes] = []
    while len(received) < len(sent):
        slots = Slots(block, HEADER, PART, 16, len(received), 16 - len(received))
        run = receiver.receive(two, slots)
        assert run is not None
        for index in range(run.count):
            assert run.sender(index) == one.getsockname()
            assert run.size(index) == len(run.copy(index))
            received.append(run.copy(index))
    assert received == sent


@pytest.mark.parametrize("receiving", RECEIVING)
def test_parts_land_in_their_places(receiving: type, pair: Pair) -> None:
    one, two = pair
    receiver, parts = receiving(), parts_of(7001)
    expected = list(parts_of(7001))
    for head, part in expected:
        one.sendmsg([head, part], [], 0, two.getsockname())
    block = bytearray(8 * PART)
    size = len(parts.packed)
    taken = 0
    while taken < 8:
        run = receiver.receive(two, Slots(block, size, PART, 8, taken, 8 - taken))
        assert run is not None
        heads = b"".join(head for head, _ in expected[taken : taken + run.count])
        sizes = [size + len(part) for _, part in expected[taken : taken + run.count]]
        assert run.follows(0, heads, sizes)
        assert not run.follows(0, heads[:-1] + b"x", sizes)
        taken += run.count
    assert bytes(block[:7001]) == parts.body


@pytest.mark.parametrize("receiving", RECEIVING)
def test_nothing_is_received_when_nothing_comes(receiving: type, pair: Pair) -> None:
    pair[1].setblocking(False)
    assert receiving().receive(pair[1], Slots(bytearray(PART), HEADER, PART, 1, 0, 1)) is None


@needs_many
def test_a_pinned_object_stays_where_it_is_until_it_is_let_go() -> None:
    data = bytearray(b"abc")
    pinned = mmsg.Pinned(data)
    with pytest.raises(BufferError):
        data.append(1)
    del pinned
    data.append(1)
