# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import pytest

from udp_bridge import BadMessage, Header, Message, TooLarge, parse
from udp_bridge.flow import DatagramKey
from udp_bridge.sending import (
    NUMBERED_TOPICS,
    SMALL_WAITING_PER_TOPIC,
    Numbering,
    Outbox,
    take_in_turn,
)

TO = ("192.0.2.1", 4000)
PARTS = 5


def message(topic: str, body: bytes = b"", msg_type: int = 2, link: str = "") -> Message:
    return Message(msg_type, topic, link, 10**18, 99, body)


def cloud(name: bytes, link: str = "", topic: str = "/points") -> Message:
    return message(topic, name * (PARTS * 1452), 1, link)


def outbox() -> Outbox:
    """Return one whose peer has a receive buffer that never fills."""
    box = Outbox(TO, "mtu")
    box.pacer.acknowledged(DatagramKey(1, "", 0, 0), 10**9, 0)
    return box


def taken(box: Outbox, count: int = 10**9) -> list[tuple[Header, bytes]]:
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


def test_numbers_count_by_type_and_topic() -> None:
    numbering = Numbering()
    given = [
        numbering.next(*key) for key in [(1, "/a"), (1, "/a"), (1, "/b"), (2, "/a"), (1, "/a")]
    ]
    assert given == [0, 1, 0, 0, 2]


@pytest.mark.parametrize(("signed_peer", "modulus"), [(False, 2**32), (True, 2**31)])
def test_numbers_wrap(signed_peer: bool, modulus: int) -> None:
    numbering = Numbering(signed_peer=signed_peer)
    numbering.next(1, "/a")
    numbering._next[1, "/a"] = modulus - 1
    assert [numbering.next(1, "/a"), numbering.next(1, "/a")] == [modulus - 1, 0]


def test_numbers_of_more_topics_than_any_peer_knows_are_forgotten() -> None:
    numbering = Numbering()
    numbering.next(1, "/first")
    for index in range(NUMBERED_TOPICS):
        numbering.next(1, str(index))
    assert numbering.next(1, "/first") == 0
    assert numbering.next(1, str(NUMBERED_TOPICS - 1)) == 1


def test_small_messages_go_at_once_and_in_order() -> None:
    box = Outbox(TO, "mtu")
    for index in range(200):
        box.put(message("/imu" if index % 2 else "/clock", bytes([index])))
    assert box.next_wake(0) == 0
    out = taken(box)
    assert [body[0] for _, body in out] == list(range(200))
    assert [header.seq_number for header, _ in out] == [index // 2 for index in range(200)]
    assert box.next_wake(0) is None


def test_small_messages_overtake_the_parts_of_large_ones() -> None:
    box = outbox()
    box.put(cloud(b"a"))
    taken(box, 2)
    box.put(message("/clock", b"t", 8))
    assert [(header.msg_type, header.part_number) for header, _ in taken(box)] == [
        (8, 0),
        *((1, number) for number in range(2, PARTS + 1)),
    ]


def test_of_large_messages_the_newest_waits_behind_the_one_on_its_way() -> None:
    box = outbox()
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
    box = Outbox(TO, "mtu", large_waiting=2 * size)
    box.pacer.acknowledged(DatagramKey(1, "", 0, 0), 10**9, 0)
    for name in (b"a", b"b", b"c"):
        box.put(cloud(name))
    out = taken(box)
    assert [body for header, body in out if header.part_number == PARTS] == [b"b", b"c"]
    assert box.superseded == 1


def test_large_messages_of_other_topics_and_links_are_not_superseded() -> None:
    box = outbox()
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
    box = Outbox(TO, "mtu")
    box.put(message("/clock", b"t", 8))
    for index in range(SMALL_WAITING_PER_TOPIC + 3):
        box.put(message("/imu", index.to_bytes(2, "big")))
    assert box.superseded == 3
    out = taken(box)
    assert len(out) == SMALL_WAITING_PER_TOPIC + 1
    assert out[0][0].topic == "/clock"
    assert [header.seq_number for header, _ in out[1:]] == list(range(SMALL_WAITING_PER_TOPIC))


def test_large_messages_wait_for_the_pacer_and_small_ones_do_not() -> None:
    box = Outbox(TO, "mtu")
    box.pacer.acknowledged(DatagramKey(1, "", 0, 0), 1000, 0)
    box.put(cloud(b"a"))
    assert len(taken(box)) == 1
    wake = box.next_wake(0)
    assert wake is not None
    assert wake > 0
    box.put(message("/clock", b"t", 8))
    assert box.next_wake(0) == 0
    assert [header.topic for header, _ in taken(box)] == ["/clock"]
    box.pacer.acknowledged(DatagramKey(1, "/points", 0, 0), 1000, 0)
    for number in range(1, PARTS + 1):
        assert [header.part_number for header, _ in taken(box)] == [number]
        assert box.pacer.stalls == 0
        box.pacer.acknowledged(DatagramKey(1, "/points", 0, number), 1000, 0)
    box.put(cloud(b"b"))
    taken(box)
    box.pacer.acknowledged(DatagramKey(1, "/points", 1, 0), 1000, 0)
    assert [header.part_number for header, _ in taken(box)] == [1]
    assert box.take(wake) is not None  # a stall
    assert box.pacer.stalls == 1


def test_destinations_take_turns() -> None:
    boxes = [Outbox((host, 1), "mtu") for host in "abc"]
    for host, count in (("a", 4), ("c", 2)):
        for _ in range(count):
            next(box for box in boxes if box.to[0] == host).put(message("/imu"))
    order = []
    while (datagram := take_in_turn(boxes, 0)) is not None:
        order.append(datagram.to[0])
    assert order == ["a", "c", "a", "c", "a", "a"]


def test_what_can_not_be_sent_is_not_queued() -> None:
    box = Outbox(TO, "mtu", signed_peer=True)
    with pytest.raises(BadMessage, match="take 235 bytes"):
        box.put(message("/" + "x" * 234))
    with pytest.raises(TooLarge, match="/points"):
        box.put(message("/points", bytes(127 * 65507)))
    assert box.next_wake(0) is None
    with pytest.raises(BadMessage, match="datagram size"):
        Outbox(TO, 100)


def test_bodies_are_not_copied() -> None:
    body = bytearray(b"a" * 3000)
    box = outbox()
    box.put(message("/points", body, 1))  # type: ignore[arg-type]
    body[0:1] = b"z"
    assert taken(box, 1)[0][1] == b"z"
