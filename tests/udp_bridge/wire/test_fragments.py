# SPDX-License-Identifier: Apache-2.0
import array
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from udp_bridge import BadMessage, Message, Reassembler, TooLarge, fragments, parse
from udp_bridge.wire.fragments import DatagramSize, plan, split
from udp_bridge.wire.types import CONTROL


def message(body: object, **fields: object) -> Message:
    whole = Message(1, "/points", "lidar", 10**18 + 7, 41, body)  # type: ignore[arg-type]
    return whole._replace(**fields)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("body_size", "header_size", "datagram", "signed_peer", "part_size", "parts"),
    [
        (0, 20, "mtu", False, 1452, 1),
        (1452, 20, "mtu", False, 1452, 1),
        (1453, 20, "mtu", False, 1452, 2),
        (255 * 1452, 20, "mtu", False, 1452, 255),
        (255 * 1452 + 1, 20, "mtu", False, 1472 + 1480 - 20, 127),
        (127 * 1452 + 1, 20, "mtu", True, 1472 + 1480 - 20, 63),
        (65280, 20, "loopback", False, 65280, 1),
        (65281, 20, "loopback", False, 65280, 2),
        (65280, 252, "loopback", False, 65507 - 252, 2),
        (255 * 65280, 20, "loopback", False, 65280, 255),
        (255 * 65280 + 1, 20, "loopback", False, 65507 - 20, 255),
        (255 * 65487, 20, "mtu", False, 65507 - 20, 255),
        (255 * (65112 - 20), 20, "mtu", False, 65112 - 20, 255),
        (255 * (65112 - 20) + 1, 20, "mtu", False, 65507 - 20, 254),
        (1000, 252, 256, False, 4, 250),
        (1021, 252, 256, False, 1472 - 252, 1),
        (9000 * 254, 20, 9000, False, 8980, 255),
        (65507 - 20, 20, 65507, False, 65507 - 20, 1),
    ],
)
def test_how_a_body_is_cut(
    body_size: int,
    header_size: int,
    datagram: DatagramSize,
    signed_peer: bool,
    part_size: int,
    parts: int,
) -> None:
    assert split(body_size, header_size, datagram, signed_peer=signed_peer) == (part_size, parts)


@given(
    st.integers(0, 17_000_000),
    st.integers(5, 63).map(lambda words: 4 * words),
    st.one_of(st.sampled_from(["mtu", "loopback"]), st.integers(256, 65507)),
)
def test_a_cut_keeps_to_the_rules(body: int, header: int, datagram: DatagramSize) -> None:
    try:
        part_size, parts = split(body, header, datagram)
    except TooLarge:
        assert body > 255 * (65507 - header)
        return
    assert part_size + header <= 65507
    assert 1 <= parts <= 255
    assert (parts - 1) * part_size < max(1, body) <= max(1, parts * part_size)


@pytest.mark.parametrize("size", [255, 65508, 0, -1, "jumbo", ""])
def test_no_size(size: DatagramSize) -> None:
    with pytest.raises(BadMessage, match=r"is neither mtu, loopback nor 256..65507 bytes"):
        fragments(message(b""), size)


def test_a_body_that_fits_at_no_size_names_topic_and_sizes() -> None:
    big = message(bytes(255 * 65475 + 1))
    with pytest.raises(TooLarge, match=r"PointCloud2 on topic '/points'.*16696126.*16696125"):
        fragments(big, "loopback")  # the iterator need not even be started
    fragments(big._replace(body=big.body[1:]), "loopback")


def test_a_signed_peer_gets_larger_datagrams_instead_of_more_parts() -> None:
    cloud = message(bytes(300_000))
    assert len(list(fragments(cloud, "mtu"))) == 209
    assert len(list(fragments(cloud, "mtu", signed_peer=True))) == 103
    with pytest.raises(TooLarge, match="127 parts"):
        fragments(message(bytes(127 * 65507)), "mtu", signed_peer=True)


def test_the_body_is_sliced_not_copied() -> None:
    body = bytearray(3000)
    parts = [part for _, part in fragments(message(body), "mtu")]
    body[2999] = 7
    assert parts[-1][-1] == 7
    assert [part.obj for part in parts] == [body] * 3


def test_headers_differ_in_the_part_number_only() -> None:
    headers = [parse(header)[0] for header, _ in fragments(message(bytes(3000)), "mtu")]
    assert [header.part_number for header in headers] == [0, 1, 2]
    assert {header._replace(part_number=0) for header in headers} == {headers[0]}
    assert headers[0].stamp_nanos == 10**18 + 7


@pytest.mark.parametrize(
    "make",
    [
        bytes,
        bytearray,
        memoryview,
        lambda body: array.array("B", body),
        lambda body: array.array("d", body),
        lambda body: memoryview(body).cast("B", (2, len(body) // 2)),
    ],
)
def test_any_contiguous_buffer_is_a_body(make: Callable[[bytes], object]) -> None:
    body = bytes(range(160))
    ((_, part),) = fragments(message(make(body)))
    assert bytes(part) == body


@pytest.mark.parametrize("body", [None, 5, "text", memoryview(bytes(10))[::2]])
def test_anything_else_is_not(body: object) -> None:
    with pytest.raises(BadMessage, match="no contiguous bytes-like object"):
        fragments(message(body))


def test_an_empty_body_is_one_empty_part() -> None:
    for body in (b"", array.array("d"), memoryview(b"").cast("B")):
        ((header, part),) = fragments(message(body))
        assert parse(header)[0].parts_max == 1
        assert part.nbytes == 0


@given(st.data())
def test_splitting_shuffling_duplicating_and_joining_gives_the_message(data: st.DataObject) -> None:
    size = data.draw(st.integers(256, 1000), label="datagram size")
    body_size = data.draw(st.integers(0, 20 * size), label="body size")
    whole = Message(
        msg_type=data.draw(st.sampled_from([1, 33, 36]), label="type"),
        topic=data.draw(st.text("/aż", max_size=40), label="topic"),
        link=data.draw(st.text("bł", max_size=40), label="link"),
        stamp_nanos=data.draw(st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1), label="stamp"),
        seq_number=data.draw(st.integers(0, 2**32 - 1), label="seq"),
        body=data.draw(st.randoms(use_true_random=False), label="random").randbytes(body_size),
    )
    parts_max = plan(whole, size).parts_max
    datagrams = [header + bytes(part) for header, part in fragments(whole, size)]
    assert all(len(datagram) <= size for datagram in datagrams)
    again = data.draw(st.lists(st.sampled_from(datagrams), max_size=10), label="duplicates")
    arriving = data.draw(st.permutations(datagrams + again), label="order")
    reassembler = Reassembler()
    received = [reassembler.receive(datagram, 0, 0) for datagram in arriving]
    (joined,) = [joined for joined in received if joined is not None]
    assert joined == whole._replace(parts=parts_max)
    assert reassembler.counters.as_dict() == {
        "messages": 1,
        "incomplete": 0,
        "duplicates": len(again),
        "late": 0,
        "missing": 0,
        "refused": {},
    }
    assert reassembler.memory_bytes == 0


@pytest.mark.parametrize("datagram", ["mtu", "loopback", 256])
def test_control_has_one_part_at_any_size(datagram: DatagramSize) -> None:
    control = message(bytes(65507 - 20 - 44), msg_type=CONTROL, topic="", link="")
    assert plan(control, datagram, reserve=44) == (65507 - 20 - 44, 1)
    [(header, part)] = fragments(control._replace(body=bytes(65507 - 20)), datagram)
    assert (len(header), len(part)) == (20, 65507 - 20)
    with pytest.raises(TooLarge, match=r"Control .* one part holds 65487"):
        fragments(control._replace(body=bytes(65507 - 19)), datagram)
