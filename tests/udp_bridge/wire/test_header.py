# SPDX-License-Identifier: Apache-2.0
import struct

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from udp_bridge import MSG_TYPES, BadMessage, Header, Refused, parse
from udp_bridge.wire.header import is_stamp, restamped

HEADER = Header(9, 5, 0, 1, 2015627261, 565643791, "/cmd_vel", "base")
NAMES = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=58)


@st.composite
def headers(draw: st.DrawFn) -> Header:
    parts_max = draw(st.integers(1, 255))
    return Header(
        msg_type=draw(st.sampled_from(sorted(MSG_TYPES))),
        seq_number=draw(st.integers(0, 2**32 - 1)),
        part_number=draw(st.integers(0, parts_max - 1)),
        parts_max=parts_max,
        time_sec=draw(st.integers(-(2**31), 2**31 - 1)),
        time_nsec=draw(st.integers(0, 10**9 - 1)),
        topic=draw(NAMES.filter(lambda name: len(name.encode()) <= 117)),
        link=draw(NAMES.filter(lambda name: len(name.encode()) <= 117)),
    )


@given(headers(), st.integers(0, 2**32 - 1), st.integers(-(2**31), 2**31 - 1), st.integers(0, 999))
def test_number_and_stamp_can_be_changed_in_place(
    header: Header, number: int, sec: int, nsec: int
) -> None:
    single = header._replace(part_number=0, parts_max=1)
    other = single._replace(seq_number=number, time_sec=sec, time_nsec=nsec)
    assert restamped(single.pack(), number, other.stamp_nanos) == other.pack()


@pytest.mark.parametrize("edge_sec", [-(2**31), 2**31])
def test_a_stamp_is_within_what_a_header_holds(edge_sec: int) -> None:
    below, at = is_stamp(edge_sec * 10**9 - 1), is_stamp(edge_sec * 10**9)
    assert (below, at) == (edge_sec > 0, edge_sec < 0)


@given(headers(), st.binary(max_size=50))
@example(Header(8, 0, 0, 1, 0, 0, "", ""), b"")
@example(Header(8, 2**32 - 1, 254, 255, -(2**31), 10**9 - 1, "t" * 117, "l" * 117), b"")
def test_packing_and_parsing_are_inverse(header: Header, body: bytes) -> None:
    packed = header.pack()
    assert parse(packed + body) == (header, len(packed))
    assert parse(memoryview(bytearray(packed + body))) == (header, len(packed))
    assert len(packed) % 4 == 0
    assert 20 <= len(packed) <= 252


@given(st.binary(max_size=300))
def test_arbitrary_bytes_parse_or_are_refused(datagram: bytes) -> None:
    try:
        header, offset = parse(datagram)
    except Refused:
        return
    # The padding is the one thing that packing may change.
    repacked = header.pack()
    assert len(repacked) == offset
    assert parse(repacked) == (header, offset)


@given(headers(), st.integers(0, 17), st.integers(0, 255))
def test_a_changed_byte_parses_or_is_refused(header: Header, index: int, value: int) -> None:
    datagram = bytearray(header.pack())
    datagram[index] = value
    try:
        parse(datagram)
    except Refused:
        pass


def test_field_offsets_match_the_table() -> None:
    packed = HEADER.pack()
    assert packed[:2] == bytes([9, 32])
    assert packed[2:8] == bytes([5, 0, 0, 0, 0, 1])
    assert packed[8:16] == struct.pack("<ii", 2015627261, 565643791)
    assert packed[16:] == b"\x08\x04/cmd_velbase\0\0"


def test_padding_is_ignored_when_received() -> None:
    packed = HEADER.pack()
    assert parse(packed[:-2] + b"\xff\xff")[0] == HEADER


def changed(offset: int, *values: int) -> bytes:
    packed = bytearray(HEADER.pack() + bytes(100))
    packed[offset : offset + len(values)] = bytes(values)
    return bytes(packed)


@pytest.mark.parametrize(
    ("datagram", "reason"),
    [
        (b"", "empty"),
        (HEADER.pack()[:17], "short"),
        (HEADER.pack()[:18], "header_size_past_end"),
        (HEADER.pack()[:-1], "header_size_past_end"),
        (changed(1, 16), "header_size_small"),
        (changed(1, 33), "header_size_unaligned"),
        (changed(1, 36), "header_size_large"),
        (changed(16, 8, 2)[:1] + b"\x20" + changed(16, 8, 2)[2:], "header_size_large"),
        (changed(1, 28), "link_past_header"),
        (changed(1, 24), "topic_past_header"),
        (changed(6, 0, 0), "parts_zero"),
        (changed(6, 1, 1), "part_past_parts"),
        (changed(12, 0, 0xCA, 0x9A, 0x3B), "nsec_too_big"),
        (changed(12, 0xFF, 0xFF, 0xFF, 0xFF), "nsec_negative"),
        (changed(17, 200), "link_past_header"),
        (changed(18, 0xFF), "topic_not_utf8"),
        (changed(18, 0), "topic_nul"),
        (changed(26, 0xFF), "link_not_utf8"),
        (changed(26, 0), "link_nul"),
        (changed(0, 0), "unknown_type"),
        (changed(0, 69), "unknown_type"),
        (changed(0, 255), "unknown_type"),
    ],
)
def test_refused_by_reason(datagram: bytes, reason: str) -> None:
    with pytest.raises(Refused, match=rf"^{reason}$"):
        parse(datagram)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"topic": "t" * 235, "link": ""}, "take 235 bytes together; at most 234 fit"),
        ({"topic": "ż" * 115, "link": "links"}, "take 235 bytes together; at most 234 fit"),
        ({"topic": "/a\0b"}, r"topic '/a\\x00b' holds a NUL character"),
        ({"link": "\ud800"}, "can't be written as UTF-8"),
        ({"time_sec": 2**31}, "time_sec is 2147483648; -2147483648..2147483647 is possible"),
        ({"time_nsec": 10**9}, "time_nsec is 1000000000; 0..999999999 is possible"),
        ({"time_nsec": -1}, "time_nsec is -1"),
        ({"seq_number": 2**32}, "seq_number is 4294967296"),
        ({"parts_max": 256}, "parts_max is 256; 1..255 is possible"),
        ({"part_number": 1}, r"part_number is 1; 0\.\.0 is possible"),
        ({"msg_type": 256}, "msg_type is 256"),
    ],
)
def test_bad_fields_are_named(change: dict[str, object], text: str) -> None:
    header = HEADER._replace(**change)  # type: ignore[arg-type]
    with pytest.raises(BadMessage, match=text):
        header.pack()


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"parts_max": 128}, r"1\.\.127 is possible"),
        ({"seq_number": 2**31}, r"0\.\.2147483647 is possible"),
        ({"topic": "t" * 103}, "at most 106 fit"),
    ],
)
def test_a_signed_peer_gets_only_what_it_understands(change: dict[str, int], text: str) -> None:
    header = HEADER._replace(**change)  # type: ignore[arg-type]
    header.pack()
    with pytest.raises(BadMessage, match=text):
        header.pack(signed_peer=True)
    fits = HEADER._replace(parts_max=127, part_number=126, seq_number=2**31 - 1, topic="t" * 102)
    signed = struct.unpack_from("<bbibbiibb", fits.pack(signed_peer=True))
    assert min(signed) >= 0


def test_stamp_in_nanoseconds() -> None:
    assert HEADER.stamp_nanos == 2015627261_565643791
    assert HEADER._replace(time_sec=-1, time_nsec=1).stamp_nanos == -999_999_999


@pytest.mark.parametrize(
    ("header", "text"),
    [
        (HEADER, "Twist #5 '/cmd_vel' link 'base' at 2015627261.565643791"),
        (
            Header(1, 41, 3, 27, 7, 5, "/points"),
            "PointCloud2 #41 part 3 of 27 '/points' at 7.000000005",
        ),
        (Header(31, 0, 0, 1, 0, 0, "a\nb"), r"type 31 #0 'a\nb' at 0.000000000"),
        (
            Header(8, 0, 0, 1, 0, 0, "/" + "x" * 100),
            f"Clock #0 '/{'x' * 36}...' at 0.000000000",
        ),
    ],
)
def test_a_header_prints_itself_on_one_short_line(header: Header, text: str) -> None:
    assert str(header) == text
