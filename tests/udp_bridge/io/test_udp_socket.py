# SPDX-License-Identifier: Apache-2.0
"""Native and portable batches do the same, over real sockets."""

import array
import contextlib
import random
import socket
import struct
from collections.abc import Iterable, Iterator
from functools import partial

import pytest

from udp_bridge import Header, Message, parse
from udp_bridge.io.native import batch_io
from udp_bridge.io.udp_socket import NativeBatches, PortableBatches
from udp_bridge.receiver.receive_slots import NO_SLOTS, CreditState, PartBatch, ReceiveSlots
from udp_bridge.receiver.small_topics import TopicOrigin, TopicRow, WholeMessage, state_of
from udp_bridge.sender.repair import Fec, repair_parts
from udp_bridge.sender.send_queue import OutgoingBatch
from udp_bridge.wire.control import Credit
from udp_bridge.wire.control import parse as parse_control
from udp_bridge.wire.fragments import Parts, Split, plan
from udp_bridge.wire.repair import Offer, Request

LOCAL = ("127.0.0.1", 0)
PART = 1000
CREDITS = CreditState(0, 1 << 20, 7)

needs_many = pytest.mark.skipif(batch_io is None, reason="the C extension was not built")
BATCHES = [pytest.param(NativeBatches, marks=needs_many), PortableBatches]
Pair = tuple[socket.socket, socket.socket]


@pytest.fixture
def pair() -> Iterator[Pair]:
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as two,
    ):
        for end in (one, two):
            end.bind(LOCAL)
        two.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
        two.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, (10).to_bytes(8, "little") * 2)
        yield one, two


def parts_of(size: int, seq_number: int = 0, topic: str = "/points") -> Parts:
    body = memoryview(random.Random(size).randbytes(size))
    count = -(-size // PART)
    message = Message(1, topic, "lidar", 5 + seq_number, seq_number, b"")
    return Parts(message.header(parts_max=count).pack(), body, Split(PART, count))


def whole(parts: Parts) -> list[bytes]:
    return [head + bytes(part) for head, part in Parts(parts.packed, parts.body, parts.cut)]


@pytest.mark.parametrize("batches", BATCHES)
def test_a_small_message_is_sent_under_its_number_and_stamp(batches: type, pair: Pair) -> None:
    one, two = pair
    header = Header(2, 9, 0, 1, 8, 7, "/imu", "imu_link")
    send = partial(batches().small_sender(one), two.getsockname(), header.pack(), 800)
    for number, stamp, body in [
        (0, 1, b""),
        (2**32 - 1, -1, array.array("d", [0.5] * 100)),
        (5, 2**31 * 10**9 - 1, memoryview(b"x" * 800)),
        (6, -(2**31) * 10**9, bytearray(b"y")),
    ]:
        sec, nsec = divmod(stamp, 10**9)
        assert send(number, stamp, body) == memoryview(body).nbytes
        sent = header._replace(seq_number=number, time_sec=sec, time_nsec=nsec).pack()
        assert two.recv(2000) == sent + bytes(memoryview(body).cast("B"))
    for stamp, body in [(1, bytes(801)), (2**31 * 10**9, b""), (-(2**31) * 10**9 - 1, b"")]:
        assert send(0, stamp, body) == -1
    for stamp, body in [(1, "text"), (1, memoryview(bytes(8))[::2]), (2**70, b"")]:
        with contextlib.suppress(TypeError, ValueError, OverflowError, BufferError):
            assert send(0, stamp, body) == -1
    two.setblocking(False)
    with pytest.raises(BlockingIOError):
        two.recv(1)


def place(
    parts: Parts, sender: socket.socket, *, is_open: bool, due_nanos: int = 0
) -> ReceiveSlots:
    count = parts.cut.parts_max
    block = bytearray(count * PART)
    name = sender.getsockname()
    return ReceiveSlots(block, parts.packed, name, PART, 0, bytearray(count), is_open, due_nanos, 0)


def delivered(pair: Pair, datagrams: Iterable[bytes]) -> Pair:
    """Send datagrams from the first socket to the second; return both."""
    one, two = pair
    for raw in datagrams:
        one.sendto(raw, two.getsockname())
    return pair


def received_natively(
    two: socket.socket, at: ReceiveSlots, credits: CreditState = CREDITS
) -> PartBatch:
    run, _ = NativeBatches().receive(two, at, credits)
    assert isinstance(run, PartBatch)
    return run


def received(
    receiving: type, two: socket.socket, at: ReceiveSlots, count: int
) -> tuple[bytes, list[PartBatch]]:
    """Receive `count` datagrams; return what lies in the block, and the runs."""
    receiver, found, credits = receiving(), [], CREDITS
    taken = 0
    while taken < count:
        run, _ = receiver.receive(two, at, credits)
        assert run is not None
        found.append(run)
        taken += run.parts_count + (run.unmatched is not None)
        for first, some in run.part_ranges:
            at.arrived[first : first + some] = b"\1" * some
        at = at._replace(next_part=max(0, at.arrived.find(0)))
        if run.parts_count:
            at = at._replace(is_open=True, header=run.header)
        credits = CreditState(run.uncredited_bytes, 1 << 20, credits.seq_number + run.credits_sent)
    return bytes(at.block), found


@pytest.mark.parametrize("sending", BATCHES)
def test_a_run_is_sent_as_its_datagrams(sending: type, pair: Pair) -> None:
    one, two = pair
    sender = sending()
    for size in (2500, 7001, 5000, 200_000):
        parts = parts_of(size)
        expected = whole(parts)
        to = two.getsockname()
        middle = parts.cut.parts_max - 1
        for first, count in ((0, middle), (middle, parts.cut.parts_max - middle)):
            assert (
                sender.send(one, OutgoingBatch(parts, first, count, size=0), to, lambda _: False)
                == count
            )
        assert [two.recv(65536) for _ in expected] == expected


@pytest.mark.parametrize("sending", BATCHES)
def test_repair_symbols_of_the_longest_names_are_sent_as_a_batch(sending: type, pair: Pair) -> None:
    one, two = pair
    message = Message(1, "/" + "n" * 233, "", 5, 0, bytes(range(256)) * 40)
    cut = plan(message, 1472, coded=True)
    symbols = repair_parts(message, cut, Fec(0.5))
    assert len(symbols.packed) == 260
    count = symbols.cut.parts_max
    run = OutgoingBatch(symbols, 0, count, size=0)
    assert sending().send(one, run, two.getsockname(), lambda _: False) == count > 1
    assert [two.recv(65536) for _ in range(count)] == whole(symbols)


@pytest.mark.parametrize("sending", BATCHES)
@pytest.mark.parametrize("is_retried", [False, True])
def test_unsendable_datagram_is_skipped_or_retried_once(
    sending: type, pair: Pair, is_retried: bool
) -> None:
    complaints: list[int] = []

    def complain(number: int) -> bool:
        complaints.append(number)
        return is_retried

    run = OutgoingBatch(parts_of(2500), 0, 3, size=0)
    assert sending().send(pair[0], run, ("255.255.255.255", 9), complain) == 0
    assert len(complaints) == (6 if is_retried else 3)


@pytest.mark.parametrize("receiving", BATCHES)
@pytest.mark.parametrize("is_anything_expected", [False, True])
def test_datagrams_of_any_size_round_trip(
    receiving: type, pair: Pair, is_anything_expected: bool
) -> None:
    rng = random.Random(1)
    sent = [rng.randbytes(size) for size in (0, 10, 32, 500, 32 + PART, 1500, 65507)]
    one, two = delivered(pair, sent)
    at = place(parts_of(16_000), one, is_open=False) if is_anything_expected else NO_SLOTS
    _, found = received(receiving, two, at, len(sent))
    assert [run.unmatched for run in found] == sent
    assert {run.unmatched_sender for run in found} == {one.getsockname()}


@pytest.mark.parametrize("receiving", BATCHES)
@pytest.mark.parametrize("is_open", [False, True])
def test_parts_land_in_their_places(receiving: type, pair: Pair, is_open: bool) -> None:
    parts = parts_of(7001)
    one, two = delivered(pair, whole(parts))
    like = parts if is_open else parts_of(7001, seq_number=900)
    block, found = received(receiving, two, place(like, one, is_open=is_open), 8)
    assert block[:7001] == parts.body
    assert [run.unmatched for run in found] == [None] * len(found)
    assert found[0].header == parts.packed
    assert found[-1].last_part_size == 1
    assert len(found) == (1 if receiving is NativeBatches else 8)


def changed(raw: bytes, index: int, value: int) -> bytes:
    return raw[:index] + bytes([value]) + raw[index + 1 :]


FIRST, SECOND, *_, LAST = whole(parts_of(4500))
WRONG = {
    "type": changed(SECOND, 0, 2),
    "header size": changed(SECOND, 1, 28),
    "number of another message": changed(SECOND, 2, 9),
    "part that is none": changed(SECOND, 6, 5),
    "count of parts": changed(SECOND, 7, 4),
    "second": changed(SECOND, 8, 9),
    "nanosecond": changed(SECOND, 12, 9),
    "topic size": changed(SECOND, 16, 6),
    "link size": changed(SECOND, 17, 4),
    "topic": changed(SECOND, 19, ord("q")),
    "link": changed(SECOND, 25, ord("q")),
    "padding": changed(SECOND, 31, 1),
    "copy of the one before": FIRST,
    "short part": SECOND[:-1],
    "long part": SECOND + b"x",
    "only a header": SECOND[:32],
    "half a header": SECOND[:16],
    "nothing": b"",
}


@pytest.mark.parametrize("receiving", BATCHES)
@pytest.mark.parametrize("wrong", WRONG.values(), ids=WRONG.keys())
def test_other_datagrams_are_returned_complete(receiving: type, pair: Pair, wrong: bytes) -> None:
    parts = parts_of(4500)
    one, two = delivered(pair, (FIRST, wrong, *whole(parts)[1:]))
    block, found = received(receiving, two, place(parts, one, is_open=False), 6)
    assert [run.unmatched for run in found if run.unmatched is not None] == [wrong]
    assert sum(run.parts_count for run in found) == 5
    assert block[:4500] == parts.body


@pytest.mark.parametrize("receiving", BATCHES)
def test_part_from_another_address_is_returned_complete(receiving: type, pair: Pair) -> None:
    one, two = pair
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(LOCAL)
        for raw, sender in ((FIRST, one), (SECOND, other), (SECOND, one)):
            sender.sendto(raw, two.getsockname())
        at = place(parts_of(4500), one, is_open=False, due_nanos=1)
        _, found = received(receiving, two, at, 3)
        strays = [
            (run.unmatched, run.unmatched_sender) for run in found if run.unmatched is not None
        ]
        assert strays == [(SECOND, other.getsockname())]
    assert sum(run.parts_count for run in found) == 2


@pytest.mark.parametrize("receiving", BATCHES)
@pytest.mark.parametrize(
    "order", [(0, 1, 3, 2, 4), (0, 4, 1, 2, 3), (0, 2, 1, 4, 3), (0, 3, 4, 1, 2)], ids=str
)
def test_parts_lie_in_their_places_in_whatever_order_they_come(
    receiving: type, pair: Pair, order: tuple[int, ...]
) -> None:
    parts = parts_of(4500)
    datagrams = whole(parts)
    one, two = delivered(pair, (datagrams[number] for number in order))
    block, found = received(receiving, two, place(parts, one, is_open=False), 5)
    assert block[: len(parts.body)] == parts.body
    rows = [row for run in found for row in run.part_ranges]
    assert [n for first, count in rows for n in range(first, first + count)] == list(order)
    assert [run.unmatched for run in found] == [None] * len(found)
    last = next(run for run in found if any(sum(row) == 5 for row in run.part_ranges))
    assert last.last_part_size == 500


@needs_many
def test_too_many_gaps_end_a_batch(pair: Pair) -> None:
    one, two = pair
    # All that comes is there before it is received; behind it nothing is worth a wait.
    two.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, struct.pack("@ll", 0, 50_000))
    parts = parts_of(200_000)
    datagrams = whole(parts)
    for number in (*range(0, 200, 2), *range(1, 200, 2)):
        one.sendto(datagrams[number], two.getsockname())
    at = place(parts, one, is_open=False)
    found: list[PartBatch] = []
    strays: list[bytes] = []
    receiver = NativeBatches()
    while sum(run.parts_count for run in found) + len(strays) < 200:
        run, _ = receiver.receive(two, at, CREDITS)
        assert run is not None
        found.append(run)
        strays += [run.unmatched] if run.unmatched is not None else []
        for first, count in run.part_ranges:
            at.arrived[first : first + count] = b"\1" * count
        at = at._replace(next_part=at.arrived.find(0), is_open=True, header=run.header or at.header)
    assert max(len(run.part_ranges) for run in found) == 64
    block = bytes(at.block)
    for number in range(200):
        if at.arrived[number]:
            assert block[number * PART : (number + 1) * PART] == datagrams[number][32:]
    assert 0 < len(strays) < 10


@needs_many
def test_a_batch_ends_when_a_request_is_due(pair: Pair) -> None:
    one, two = pair
    datagrams = whole(parts_of(4500))
    one.sendto(datagrams[0], two.getsockname())
    one.sendto(datagrams[2], two.getsockname())
    at = place(parts_of(4500), one, is_open=False)._replace(debounce_nanos=1)
    run = received_natively(two, at)
    assert (run.part_ranges, run.unmatched) == (((0, 1), (2, 1)), None)


def request_of(topic: str, *parts: int) -> bytes:
    """Return the request that Python would send for parts of a message of 5."""
    head = Header(65, 3, 0, 1, 0, 8, topic).pack()
    return head + Request(1, 5, 1, 999, parts).pack()


def offer_of(topic: str, **other: int) -> bytes:
    """Return the offer of such a message, or of another one."""
    offer = Offer(1, other.pop("parts_max", 5), 500)
    return Header(65, 3, 0, 1, 0, 8, topic)._replace(**other).pack() + offer.pack()


def place_to_ask(parts: Parts, sender: socket.socket, debounce_nanos: int) -> ReceiveSlots:
    at = place(parts, sender, is_open=False)
    return at._replace(debounce_nanos=debounce_nanos, may_nack=True)


REQUESTING = CREDITS._replace(goodput=999)
LONG_NANOS = 10**10


@needs_many
@pytest.mark.parametrize("topic", ["/points", "", "/" + "t" * 200])
def test_a_gap_is_requested_as_python_would_and_filled_in_the_same_batch(
    pair: Pair, topic: str
) -> None:
    parts = parts_of(4500, 3, topic)
    one, two = delivered(pair, (whole(parts)[number] for number in (0, 2, 1, 3, 4)))
    one.settimeout(10.0)
    at = place_to_ask(parts, one, 1)
    run = received_natively(two, at, REQUESTING)
    assert run.part_ranges == ((0, 1), (2, 1), (1, 1), (3, 2))
    assert run.nack_bitmap == b"\2"
    assert run.nack_nanos > 0
    assert one.recv(1000) == request_of(topic, 1)
    assert bytes(at.block)[:4500] == parts.body


@needs_many
@pytest.mark.parametrize("topic", ["/points", "", "/" + "t" * 200])
def test_an_offer_behind_parts_is_answered_at_once_and_handed_over(pair: Pair, topic: str) -> None:
    parts = parts_of(4500, 3, topic)
    offer = offer_of(topic)
    one, two = delivered(pair, (*(whole(parts)[number] for number in (0, 1, 3)), offer))
    one.settimeout(10.0)
    run = received_natively(two, place_to_ask(parts, one, LONG_NANOS), REQUESTING)
    assert (run.part_ranges, run.unmatched) == (((0, 2), (3, 1)), offer)
    assert run.nack_bitmap == b"\x14"
    assert one.recv(1000) == request_of(topic, 2, 4)


@needs_many
@pytest.mark.parametrize(
    "stray",
    [
        offer_of("/points", seq_number=4),
        offer_of("/points", time_nsec=9),
        offer_of("/points", parts_max=6),
        offer_of("/pointz"),
        offer_of("/points") + b"\0",
        offer_of("/points")[:-1],
        request_of("/points", 1),
        b"",
    ],
)
def test_nothing_is_requested_after_another_datagram(pair: Pair, stray: bytes) -> None:
    parts = parts_of(4500, 3)
    one, two = delivered(pair, (whole(parts)[0], whole(parts)[2], stray))
    one.setblocking(False)
    run = received_natively(two, place_to_ask(parts, one, LONG_NANOS), REQUESTING)
    assert (run.unmatched, run.nack_bitmap) == (stray, b"")
    with pytest.raises(BlockingIOError):
        one.recv(1000)


@pytest.mark.parametrize("receiving", BATCHES)
@pytest.mark.parametrize("nsec", [10**9, -1])
def test_a_time_that_is_none_begins_no_message(receiving: type, pair: Pair, nsec: int) -> None:
    wrong = FIRST[:12] + nsec.to_bytes(4, "little", signed=True) + FIRST[16:]
    one, two = delivered(pair, [wrong])
    _, found = received(receiving, two, place(parts_of(4500), one, is_open=False), 1)
    assert [run.unmatched for run in found] == [wrong]


@needs_many
def test_nonblocking_receive_takes_available_datagrams_only(pair: Pair) -> None:
    one, two = delivered(pair, [FIRST])
    at = place(parts_of(4500), one, is_open=False, due_nanos=1)
    run = received_natively(two, at)
    assert (run.parts_count, run.unmatched) == (1, None)


@needs_many
@pytest.mark.parametrize("topic", ["/points", "", "/" + "t" * 200])
def test_credits_are_those_that_python_would_send(pair: Pair, topic: str) -> None:
    parts = parts_of(20_500, 3, topic)
    one, two = delivered(pair, whole(parts))
    one.settimeout(10.0)
    size = len(whole(parts)[0])
    buffer = 8 * (10 * size - 1)  # one for every ten parts, and one at the end
    batches, at = NativeBatches(), place(parts, one, is_open=True)
    run, _ = batches.receive(two, at, CreditState(0, buffer, 2**32 - 1))
    assert isinstance(run, PartBatch)
    assert (run.parts_count, run.credits_sent, run.uncredited_bytes) == (21, 3, 0)
    for number, part in ((2**32 - 1, 9), (0, 19), (1, 20)):
        if part == 20:  # it is sent when the user has got the message
            one.setblocking(False)
            with pytest.raises(BlockingIOError):
                one.recv(1000)
            one.settimeout(10.0)
            two.setblocking(False)
            batches.receive(two, NO_SLOTS, CREDITS)
        _, offset = parse(raw := one.recv(1000))
        told = Message(64, topic, "", 5 + 3, number, b"")
        assert raw[:offset] == told.header().pack()
        assert parse_control(raw[offset:]) == Credit(1, part, 3, buffer)


IMU = 2
"""A type whose messages are ordered by stamp."""


def row_of(msg_type: int, last: tuple[int, int]) -> TopicRow:
    source = TopicOrigin(("127.0.0.1", 1), (msg_type, "/points"), "lidar")
    return source, state_of(msg_type, last), msg_type, "/points", "lidar"


@needs_many
@pytest.mark.parametrize("size", [1001, 4500, 20_000])
def test_the_next_message_is_returned_as_such_if_it_is_whole(pair: Pair, size: int) -> None:
    parts = parts_of(size, 3)
    one, two = delivered(pair, whole(parts))
    row = row_of(1, (2, 7))
    found, _ = NativeBatches().receive(
        two, place(parts, one, is_open=False)._replace(row=row), CREDITS
    )
    assert isinstance(found, WholeMessage)
    count = parts.cut.parts_max
    assert found.message == Message(1, "/points", "lidar", 8, 3, parts.body, count)
    assert found.message.body.readonly
    assert (found.header, found.credits_sent) == (parts.packed, 1)
    total = size + count * len(parts.packed)
    assert found.delivered[:5] == (row[0], (3, 8), size, count, total)
    assert row[1] == state_of(1, (3, 8))


@needs_many
@pytest.mark.parametrize(
    ("last", "is_open", "order"),
    [
        ((1, 7), False, (0, 1, 2)),  # another number is next
        ((3, 7), False, (0, 1, 2)),
        ((2, 9), False, (0, 1, 2)),  # it is older
        ((2, 7), True, (0, 1, 2)),  # parts of it arrived before
        ((2, 7), False, (0, 2, 1)),
    ],
)
def test_any_other_message_is_returned_as_its_parts(
    pair: Pair, last: tuple[int, int], is_open: bool, order: tuple[int, ...]
) -> None:
    parts = parts_of(2500, 3)
    one, two = delivered(pair, (whole(parts)[number] for number in order))
    row = row_of(IMU, last)
    at = place(parts, one, is_open=is_open)._replace(row=row)
    run, _ = NativeBatches().receive(two, at, CREDITS)
    assert isinstance(run, PartBatch)
    assert run.parts_count == 3
    assert row[1] == state_of(IMU, last)


@needs_many
def test_a_row_of_a_topic_is_checked(pair: Pair) -> None:
    parts = parts_of(2500, 3)
    for row in [(1, 2), (None, b"x" * 16, 1, "", ""), (None, bytearray(15), 1, "", "")]:
        one, two = delivered(pair, whole(parts))
        at = place(parts, one, is_open=False)._replace(row=row)  # type: ignore[arg-type]
        with pytest.raises(TypeError):
            NativeBatches().receive(two, at, CREDITS)


@needs_many
@pytest.mark.parametrize("size", [1001, 20_000, 1000 * 255])
def test_a_large_message_is_sent_under_its_number_and_stamp(pair: Pair, size: int) -> None:
    one, two = pair
    parts, unsent = parts_of(size), list[int]()
    send = NativeBatches().large_sender(one, unsent.append)
    assert send is not None
    shape = parts.packed, size, PART, parts.cut.parts_max
    assert send(two.getsockname(), *shape, 2**32 - 1, -1, parts.body) == parts.cut.parts_max
    header = Message(1, "/points", "lidar", -1, 2**32 - 1, b"").header(
        parts_max=parts.cut.parts_max
    )
    assert [two.recv(2000) for _ in range(parts.cut.parts_max)] == whole(
        Parts(header.pack(), parts.body, parts.cut)
    )
    assert send(two.getsockname(), *shape, 0, 1, parts.body[1:]) == -1
    assert send(two.getsockname(), *shape, 0, 2**31 * 10**9, parts.body) == -1
    for wrong in [(b"", *shape[1:]), (*shape[:3], parts.cut.parts_max + 1)]:
        with pytest.raises(ValueError, match=r"no header|do not lie"):
            send(two.getsockname(), *wrong, 0, 1, parts.body)
    assert unsent == []


@needs_many
def test_parts_that_the_kernel_does_not_take_are_counted(pair: Pair) -> None:
    one, two = pair
    parts, unsent = parts_of(2500), list[int]()
    send = NativeBatches().large_sender(one, unsent.append)
    assert send is not None
    huge = bytes(2 * 65_600 + 5)  # the first two datagrams would be larger than any
    assert send(two.getsockname(), parts.packed, len(huge), 65_600, 3, 0, 1, huge) == 1
    assert unsent == [2]
    assert two.recv(2000)[6] == 2


@pytest.mark.parametrize("receiving", BATCHES)
def test_nothing_is_received_when_nothing_comes(receiving: type, pair: Pair) -> None:
    pair[1].setblocking(False)
    assert receiving().receive(pair[1], NO_SLOTS, CREDITS)[0] is None


@needs_many
@pytest.mark.parametrize(
    "change",
    [
        {"next_part": 5},
        {"next_part": -1},
        {"next_part": 2, "arrived": bytearray(b"\0\0\1\0\0")},
        {"arrived": bytearray(256)},
        {"arrived": bytearray(6)},
        {"part_size": 1001},
        {"part_size": 2**62},
        {"part_size": 0},
        {"header": b""},
        {"header": b"\xff" * 32},
        {"header": bytes(256)},
        {"sender": ("nowhere", 5)},
        {"sender": ("127.0.0.1", 65536)},
    ],
    ids=str,
)
def test_a_place_that_is_none_is_an_error(pair: Pair, change: dict[str, object]) -> None:
    at = place(parts_of(4500), pair[0], is_open=False)._replace(**change)  # type: ignore[arg-type]
    pair[1].setblocking(False)
    with pytest.raises(ValueError, match=r"block|address"):
        NativeBatches().receive(pair[1], at, CREDITS)


@needs_many
@pytest.mark.parametrize(("first", "count"), [(-1, 2), (3, 0), (3, 3), (0, 300)])
def test_parts_that_are_none_are_an_error(pair: Pair, first: int, count: int) -> None:
    run = OutgoingBatch(parts_of(4500), first, count, size=0)
    if count <= 0:
        assert NativeBatches().send(pair[0], run, pair[1].getsockname(), lambda _: False) == 0
        return
    with pytest.raises(ValueError, match="parts do not lie in the body"):
        NativeBatches().send(pair[0], run, pair[1].getsockname(), lambda _: False)


@needs_many
def test_an_empty_datagram_is_no_credit_before_one_was_sent_for() -> None:
    """The sanitizers judge, see `fuzz/sanitized.py`.

    A sender whose address is all zero is the one that memory for credits begins with. IPv4 has
    it in broadcasts only, so here a name in another family stands for it, whose bytes are zero.
    """
    with (
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as one,
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as two,
    ):
        one.bind(bytes(12))
        two.bind("")  # any free name
        one.sendto(b"", two.getsockname())
        run = received_natively(two, NO_SLOTS, CREDITS)
    assert (run.unmatched, run.unmatched_sender, run.mailbox_credits) == (b"", ("0.0.0.0", 0), 0)
