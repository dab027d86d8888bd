# SPDX-License-Identifier: Apache-2.0
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from udp_bridge import BadMessage, Header, Message, TooLarge, parse
from udp_bridge.sender.direct_senders import DirectSenders
from udp_bridge.sender.flow_control import BATCH_BYTES
from udp_bridge.sender.repair import Fec, Mode, RepairTable, Resend
from udp_bridge.sender.send_queue import (
    MAX_TEMPLATES,
    OutgoingDatagram,
    SendQueue,
    take_in_turn,
)
from udp_bridge.sender.waiting import SMALL_PER_TOPIC
from udp_bridge.wire.fragments import Split, datagram_of
from udp_bridge.wire.header import Buffer, is_stamp, restamped
from udp_bridge.wire.message import Address, DatagramKey
from udp_bridge.wire.repair import Offer, Request, parse_resend

TO = ("192.0.2.1", 4000)
PARTS = 5


def message(topic: str, body: bytes = b"", msg_type: int = 2, link: str = "") -> Message:
    return Message(msg_type, topic, link, 10**18, 99, body)


def cloud(name: bytes, link: str = "", topic: str = "/points") -> Message:
    return message(topic, name * (PARTS * 1452), 1, link)


def queue() -> SendQueue:
    """Return one whose peer has a receive buffer that never fills."""
    box = SendQueue(TO, "mtu")
    box.flow.acknowledged(DatagramKey(1, "", 0, 0), 10**9, 0)
    return box


def taken(box: SendQueue, count: int = 10**9) -> list[tuple[Header, bytes]]:
    """Return header and the body's first byte of all that goes now."""
    out: list[tuple[Header, bytes]] = []
    while len(out) < count:
        datagram = box.take(0)
        if datagram is None:
            break
        assert datagram.to == TO
        header, offset = parse(datagram.header)
        assert offset == len(datagram.header)
        assert datagram.is_last == (header.part_number == header.parts_max - 1)
        out.append((header, bytes(datagram.part[:1])))
    return out


def test_small_messages_go_at_once_and_in_order() -> None:
    box = SendQueue(TO, "mtu")
    for index in range(200):
        box.put(message("/imu" if index % 2 else "/clock", bytes([index])))
    assert box.next_wake(0) == 0
    out = taken(box)
    assert [body[0] for _, body in out] == list(range(200))
    assert [header.seq_number for header, _ in out] == [index // 2 for index in range(200)]
    assert box.next_wake(0) is None


def test_small_messages_overtake_the_parts_of_large_ones() -> None:
    box = queue()
    box.put(cloud(b"a"))
    taken(box, 2)
    box.put(message("/clock", b"t", 8))
    assert [(header.msg_type, header.part_number) for header, _ in taken(box)] == [
        (8, 0),
        *((1, number) for number in range(2, PARTS + 1)),
    ]


def test_of_large_messages_the_newest_waits_behind_the_one_on_its_way() -> None:
    box = queue()
    box.put(cloud(b"a"))
    taken(box, 1)
    for name in (b"b", b"c", b"d"):
        box.put(cloud(name))
    out = taken(box)
    assert [body for header, body in out if header.part_number == PARTS] == [b"a", b"d"]
    assert {header.seq_number for header, _ in out} == {0, 1}  # no gap for what never left
    assert box.superseded == 2


def test_blocks_of_a_whole_wait_for_each_other_within_their_bytes() -> None:
    size = PARTS * 1452
    box = SendQueue(TO, "mtu", limits={(1, "/points"): 2 * size})
    box.flow.acknowledged(DatagramKey(1, "", 0, 0), 10**9, 0)
    for name in (b"a", b"b", b"c"):
        box.put(cloud(name))
    out = taken(box)
    assert [body for header, body in out if header.part_number == PARTS] == [b"b", b"c"]
    assert box.superseded == 1


def test_large_messages_of_other_topics_and_links_are_not_superseded() -> None:
    box = queue()
    for link, topic in (("l1", "/points"), ("l2", "/points"), ("l1", "/more")):
        box.put(cloud(b"a", link, topic))
    box.put(cloud(b"b", "l1"))  # keeps the place of the one that it replaces
    ends = [(header, body) for header, body in taken(box) if header.part_number == PARTS]
    assert [(header.topic, header.link, header.seq_number, body) for header, body in ends] == [
        ("/points", "l1", 0, b"b"),
        ("/points", "l2", 1, b"a"),
        ("/more", "l1", 0, b"a"),
    ]
    assert box.superseded == 1


def test_waiting_small_messages_are_bounded_by_topic_and_the_oldest_go() -> None:
    box = SendQueue(TO, "mtu")
    box.put(message("/clock", b"t", 8))
    for index in range(SMALL_PER_TOPIC + 3):
        box.put(message("/imu", index.to_bytes(2, "big")))
    assert box.superseded == 3
    out = taken(box)
    assert len(out) == SMALL_PER_TOPIC + 1
    assert out[0][0].topic == "/clock"
    assert [header.seq_number for header, _ in out[1:]] == list(range(SMALL_PER_TOPIC))


def test_large_messages_wait_for_the_pacer_and_small_ones_do_not() -> None:
    box = SendQueue(TO, "mtu")
    box.flow.acknowledged(DatagramKey(1, "", 0, 0), 1000, 0)
    box.put(cloud(b"a"))
    assert len(taken(box)) == 1
    wake = box.next_wake(0)
    assert wake is not None
    assert wake > 0
    box.put(message("/clock", b"t", 8))
    assert box.next_wake(0) == 0
    assert [header.topic for header, _ in taken(box)] == ["/clock"]
    box.flow.acknowledged(DatagramKey(1, "/points", 0, 0), 1000, 0)
    for number in range(1, PARTS + 1):
        assert [header.part_number for header, _ in taken(box)] == [number]
        assert box.flow.stalls == 0
        box.flow.acknowledged(DatagramKey(1, "/points", 0, number), 1000, 0)
    box.put(cloud(b"b"))
    taken(box)
    box.flow.acknowledged(DatagramKey(1, "/points", 1, 0), 1000, 0)
    assert [header.part_number for header, _ in taken(box)] == [1]
    assert box.take(wake) is not None  # a stall
    assert box.flow.stalls == 1


def test_destinations_take_turns() -> None:
    boxes = [SendQueue((host, 1), "mtu") for host in "abc"]
    for host, count in (("a", 4), ("c", 2)):
        for _ in range(count):
            next(box for box in boxes if box.to[0] == host).put(message("/imu"))
    order = []
    while (datagram := take_in_turn(boxes, 0)) is not None:
        order.append(datagram.to[0])
    assert order == ["a", "c", "a", "c", "a", "a"]


def test_unsendable_messages_are_not_queued() -> None:
    box = SendQueue(TO, "mtu", signed_peer=True)
    with pytest.raises(BadMessage, match="take 235 bytes"):
        box.put(message("/" + "x" * 234))
    with pytest.raises(TooLarge, match="/points"):
        box.put(message("/points", bytes(127 * 65507)))
    assert box.next_wake(0) is None
    with pytest.raises(BadMessage, match="datagram size"):
        SendQueue(TO, 100)


def test_bodies_are_not_copied() -> None:
    body = bytearray(b"a" * 3000)
    box = queue()
    box.put(message("/points", body, 1))  # type: ignore[arg-type]
    body[0:1] = b"z"
    assert taken(box, 1)[0][1] == b"z"


IMU = (2, "/imu", "imu_link")
"""Type, topic and link of a small message."""


def taken_small(
    box: SendQueue, stamp_nanos: int, body: Any, topic: tuple[int, str, str] = IMU
) -> OutgoingDatagram | None:
    """Return the datagram that a stand-in for the socket gets; None if the queue has to be used."""
    sent = []

    def send(
        to: Address, packed: bytes, most: int, number: int, stamp_nanos: int, body: Buffer
    ) -> int:
        view = memoryview(body)
        if view.nbytes > most or not is_stamp(stamp_nanos):
            return -1
        sent.append(OutgoingDatagram(restamped(packed, number, stamp_nanos), view, to, True))
        return view.nbytes

    size = box.send_small_directly(send, *topic, stamp_nanos, body)
    assert size == sum(len(one.header) + one.part.nbytes for one in sent)
    return sent[0] if sent else None


def queue_with_template(**options: Any) -> SendQueue:
    """Return an queue by which a small message has gone the long way."""
    box = SendQueue(TO, "mtu", **options)
    box.put(message("/imu", b"first", link="imu_link"))
    while box.take(0) is not None:
        pass
    return box


@given(
    st.lists(
        st.tuples(st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1), st.binary(max_size=80)),
        max_size=6,
    ),
    st.booleans(),
)
def test_taking_a_small_message_directly_equals_put_and_take(
    messages: list[tuple[int, bytes]], signed_peer: bool
) -> None:
    short, long = (
        queue_with_template(signed_peer=signed_peer),
        queue_with_template(signed_peer=signed_peer),
    )
    for stamp_nanos, body in messages:
        at_once = taken_small(short, stamp_nanos, body)
        long.put(Message(*IMU, stamp_nanos, 0, body))
        queued = long.take(0)
        assert at_once is not None
        assert queued is not None
        assert at_once._replace(part=memoryview(bytes(at_once.part))) == queued
    assert short.delivery.counts(0) == long.delivery.counts(0)


def test_small_messages_that_are_not_alike_are_queued() -> None:
    assert taken_small(SendQueue(TO, "mtu"), 1, b"x") is None  # nothing is known of its topic
    box = queue_with_template()
    largest = 1472 - len(Header(2, 0, 0, 1, 0, 0, "/imu", "imu_link").pack())
    assert taken_small(box, 1, bytes(largest + 1)) is None
    assert taken_small(box, 2**31 * 10**9, b"x") is None
    assert taken_small(box, -(2**31) * 10**9 - 1, b"x") is None
    assert taken_small(box, 1, b"x", (2, "/imu", "other_link")) is None
    box.put(message("/clock", b"t", 8))
    assert taken_small(box, 1, b"x") is None  # it would overtake one that waits
    taken(box)
    datagram = taken_small(box, 1, bytes(largest))
    assert datagram is not None
    assert parse(datagram.header)[0].seq_number == 1  # none was used up above
    assert taken_small(box, 1, "text") is None


@pytest.mark.parametrize("mode", [Resend(10**9), Fec(0.2)])
def test_small_messages_with_repair_are_queued(mode: Mode) -> None:
    if isinstance(mode, Fec):
        pytest.importorskip("raptorq")
    assert taken_small(queue_with_template(repair={(2, "/imu"): mode}), 1, b"x") is None


def cloud_of(size: int, stamp_nanos: int = 5, topic: str = "/image") -> Message:
    return Message(33, topic, "camera", stamp_nanos, 0, bytes(size))


def queue_with_large_template(size: int, **options: Any) -> SendQueue:
    """Return an queue by which a large message has gone the long way, and that got a Credit."""
    box = SendQueue(TO, "loopback", **options)
    box.flow.acknowledged(DatagramKey(33, "", 0, 0), 8 << 20, 0)
    box.put(cloud_of(size))
    while box.take(0, 1 << 20) is not None:
        pass
    return box


def taken_large(box: SendQueue, message: Message, most_bytes: int) -> OutgoingDatagram | None:
    msg_type, topic, link, stamp_nanos, _, body, _ = message
    return box.take_large_directly(0, most_bytes, msg_type, topic, link, stamp_nanos, body)


def taken_whole(
    box: SendQueue, message: Message, *others: SendQueue, lost: int = 0
) -> tuple[tuple[int, int, int], list[tuple[bytes, bytes]]]:
    """Return what `send_directly` returns, and the datagrams that the socket gets."""
    sent = []

    def send(
        _: Address, packed: bytes, size: int, part: int, parts: int, number: int, at: int, body: Any
    ) -> int:
        if memoryview(body).nbytes != size:
            return -1
        stamped = restamped(packed, number, at)
        sent.extend(
            (bytes(head), bytes(piece))
            for head, piece in (
                datagram_of(stamped, memoryview(body), Split(part, parts), index)
                for index in range(parts)
            )
        )
        return parts - lost

    msg_type, topic, link, stamp_nanos, _, body, _ = message
    fields = (msg_type, topic, link, stamp_nanos, body)
    result = box.send_directly(DirectSenders(large=send), [box, *others], 0, *fields)
    return result, sent


@settings(max_examples=40)  # to compare a megabyte takes a while
@given(
    st.integers(65_281, 700_000),  # five of these fit into the window
    st.lists(st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1), min_size=1, max_size=4),
    st.booleans(),
)
def test_sending_a_large_message_by_one_call_equals_put_and_take(
    size: int, stamps: list[int], signed_peer: bool
) -> None:
    short, long = (queue_with_large_template(size, signed_peer=signed_peer) for _ in range(2))
    for stamp_nanos in stamps:
        result, datagrams = taken_whole(short, cloud_of(size, stamp_nanos))
        long.put(cloud_of(size, stamp_nanos))
        queued = []
        while (one := long.take(0)) is not None:
            queued.append((one.header, bytes(one.part)))
        assert datagrams == queued
        total = sum(len(head) + len(body) for head, body in datagrams)
        assert result == (total, len(datagrams), len(datagrams))
        assert short.current_topic == (33, "/image")
    assert short.delivery.counts(0) == long.delivery.counts(0)
    assert short.flow.window.in_flight_bytes == long.flow.window.in_flight_bytes


def test_a_large_message_that_has_to_wait_is_not_sent_by_one_call() -> None:
    size = 200_000
    box = queue_with_large_template(size)
    nothing = ((0, 0, 0), [])
    assert taken_whole(box, cloud_of(size + 1)) == nothing
    assert taken_whole(box, cloud_of(size, topic="/other")) == nothing
    assert taken_whole(box, cloud_of(size, 2**31 * 10**9)) == nothing
    assert taken_whole(box, message("/imu")) == nothing
    other = queue_with_large_template(size)
    other.put(cloud_of(size))
    assert taken_whole(box, cloud_of(size), other) == nothing  # it would overtake one that waits
    huge = queue_with_large_template(BATCH_BYTES)
    assert taken_whole(huge, cloud_of(BATCH_BYTES)) == nothing
    resent = queue_with_large_template(size, repair={(33, "/image"): Resend(10**9)})
    assert taken_whole(resent, cloud_of(size)) == nothing
    stranger = SendQueue(TO, "loopback")  # no Credit came
    stranger.put(cloud_of(size))
    while stranger.take(10**9, 1 << 20) is not None:
        pass
    assert taken_whole(stranger, cloud_of(size)) == nothing
    assert taken_whole(box, cloud_of(size))[0][1:] == (4, 4)
    while (result := taken_whole(box, cloud_of(size)))[0][2]:
        pass
    assert result == nothing  # the window is full
    assert box.flow.window.room(65_312) < 4


def test_parts_that_were_not_sent_by_one_call_are_not_counted_as_sent() -> None:
    box = queue_with_large_template(200_000)
    (size, sent, parts), datagrams = taken_whole(box, cloud_of(200_000), lost=1)
    assert (sent, parts) == (3, 4)
    assert size == 3 * (len(datagrams[0][0]) + len(datagrams[0][1]))


@settings(max_examples=40)  # to compare a megabyte takes a while
@given(
    st.integers(65_281, 1_200_000),
    st.lists(st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1), max_size=4),
    st.sampled_from((70_000, 200_000, 1 << 20)),
    st.booleans(),
    st.sampled_from(({}, {(33, "/image"): Resend(10**9)})),
)
@example(1_015_097, [0, 0, 0, 0], 70_000, False, {})
@example(1_015_097, [0, 0, 0, 0], 1 << 20, False, {(33, "/image"): Resend(10**9)})
def test_taking_a_large_message_directly_equals_put_and_take(
    size: int, stamps: list[int], most_bytes: int, signed_peer: bool, repair: RepairTable
) -> None:
    short, long = (
        queue_with_large_template(size, signed_peer=signed_peer, repair=repair) for _ in range(2)
    )
    for stamp_nanos in stamps:
        at_once = taken_large(short, cloud_of(size, stamp_nanos), most_bytes)
        if at_once is None:  # the window is full
            short.put(cloud_of(size, stamp_nanos))
            at_once = short.take(0, most_bytes)
        long.put(cloud_of(size, stamp_nanos))
        while (queued := long.take(0, most_bytes)) is not None:
            assert at_once is not None
            assert (*at_once[:4], at_once.batch and at_once.batch[1:]) == (
                *queued[:4],
                queued.batch and queued.batch[1:],
            )
            if queued.batch is not None and at_once.batch is not None:
                assert at_once.batch.parts.packed == queued.batch.parts.packed
            at_once = short.take(0, most_bytes)
        assert at_once is None
    assert short.delivery.counts(0) == long.delivery.counts(0)
    assert short.flow.window.in_flight_bytes == long.flow.window.in_flight_bytes
    assert short.resender.history_bytes == long.resender.history_bytes
    assert short.resender.next_offer_nanos == long.resender.next_offer_nanos


def left_with(most_bytes: int, names: str) -> tuple[list[bytes], list[bool], int, int]:
    """Return all datagrams of two coded blocks, which ended a message, the calls, and the cost."""
    block = Message(1, names, names[:-3], 5, 0, bytes(i % 251 for i in range(26_400)))
    box = SendQueue(TO, "mtu", repair={(1, names): Fec(0.3)})
    box.flow.acknowledged(DatagramKey(1, "", 0, 0), 10**9, 0)
    datagrams, ends, calls = [], [], 0
    for _ in range(2):
        box.put(block)
        while (datagram := box.take(0, most_bytes)) is not None:
            run, calls = datagram.batch, calls + 1
            pieces = [(datagram.header, datagram.part)]
            if run is not None:
                numbers = range(run.first, run.first + run.parts_count)
                parts = run.parts
                pieces = [datagram_of(parts.packed, parts.body, parts.cut, n) for n in numbers]
                assert run.size == sum(len(head) + part.nbytes for head, part in pieces)
            datagrams += [head + bytes(part) for head, part in pieces]
            ends += [False] * (len(pieces) - 1) + [datagram.is_last]
        assert box.is_idle
    return datagrams, ends, calls, box.flow.window.in_flight_bytes


@pytest.mark.parametrize("names", ["/points", "/" + "n" * 116])
def test_a_message_with_fec_is_sent_in_two_batches_parts_and_repair(names: str) -> None:
    datagrams, ends, calls, in_flight = left_with(1 << 20, names)
    assert (datagrams, ends, in_flight) == (*(left := left_with(0, names))[:2], left[3])
    assert calls == 4
    assert left[2] == len(datagrams) >= 50
    assert sum(ends) == 2


def test_a_directly_sent_message_is_resent_on_request() -> None:
    box = queue_with_large_template(700_000, repair={(33, "/image"): Resend(10**9)})
    message = cloud_of(700_000)
    at_once = taken_large(box, message, 1 << 20)
    assert at_once is not None
    assert at_once.batch is not None
    header, offset = parse(at_once.batch.trailer or b"")
    assert parse_resend((at_once.batch.trailer or b"")[offset:]) == Offer(33, 11, 1000)
    request = Request(33, 11, 1, 10**6, (3,))
    box.resender.requested(header, request, 2 * 10**6)
    again = box.take(2 * 10**6)
    assert again is not None
    assert again.header == at_once.header[:6] + b"\3" + at_once.header[7:]
    assert again.part == memoryview(message.body)[3 * 65_280 : 4 * 65_280]


def test_large_messages_that_are_not_alike_are_queued() -> None:
    most, fits = 1 << 20, cloud_of(700_000)
    fresh = SendQueue(TO, "loopback")
    assert taken_large(fresh, fits, most) is None  # nothing is known of its topic
    box = queue_with_large_template(700_000)
    for other in (
        cloud_of(700_001),
        cloud_of(700_000, 2**31 * 10**9),
        cloud_of(700_000, topic="/other"),
        fits._replace(link="elsewhere"),
    ):
        assert taken_large(box, other, most) is None
    assert taken_large(box, fits, 0) is None  # a socket that takes no runs
    sent = 0
    while box.is_idle and taken_large(box, fits, most) is not None:
        sent += 1
    assert sent == 5  # four and a part of the fifth fill half of the peer's buffer, with the first
    assert not box.is_idle
    resent = queue_with_large_template(700_000, repair={(33, "/image"): Resend(10**9)})
    fields = (33, "/image", "camera", 5, fits.body)
    assert resent.take_large_directly(10**6, most, *fields) is None  # an offer is due


def test_templates_are_bounded() -> None:
    box = SendQueue(TO, "mtu")
    for index in range(2 * MAX_TEMPLATES + 1):
        box.put(message(str(index), b"x"))
        taken(box)
        assert len(box._templates) <= MAX_TEMPLATES
