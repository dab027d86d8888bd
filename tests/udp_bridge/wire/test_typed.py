# SPDX-License-Identifier: Apache-2.0
import pytest

from tests.udp_bridge.vectors import load
from udp_bridge import Reassembler, Refused
from udp_bridge.wire.header import BadMessage
from udp_bridge.wire.typed import pack_typed, parse_typed

MAGNETIC = "sensor_msgs/msg/MagneticField"
CDR = b"\x00\x01\x00\x00body"


@pytest.mark.parametrize("ros_type", ["a/msg/B", "a_1/msg/Bc", "my_msgs/msg/Abc", MAGNETIC])
def test_the_cdr_begins_at_a_multiple_of_8_behind_the_name(ros_type: str) -> None:
    body = pack_typed(ros_type, CDR)
    assert parse_typed(memoryview(body)) == (ros_type, len(body) - len(CDR))
    offset = parse_typed(body).offset
    assert offset % 8 == 0
    assert body == bytes([len(ros_type)]) + ros_type.encode().ljust(offset - 1, b"\0") + CDR


def test_the_longest_name_takes_256_bytes() -> None:
    longest = "a" * 249 + "/msg/B"
    assert parse_typed(pack_typed(longest, b"")) == (longest, 256)
    with pytest.raises(BadMessage, match="at most 255 bytes"):
        pack_typed("a" + longest, b"")


@pytest.mark.parametrize(
    "ros_type",
    [
        "",
        "Imu",
        "sensor_msgs/Imu",
        "a/srv/B",
        "A/msg/B",
        "a/msg/b",
        "a/msg/",
        "/msg/B",
        "a/msg/B\n",
    ],
)
def test_other_names_are_refused(ros_type: str) -> None:
    with pytest.raises(BadMessage, match="expected package/msg/Name"):
        pack_typed(ros_type, CDR)
    size = len(ros_type)
    body = bytes([size]) + ros_type.encode() + bytes(-(1 + size) % 8) + CDR
    with pytest.raises(Refused, match="type_name"):
        parse_typed(body)


@pytest.mark.parametrize("body", [b"", b"\x07a/msg/", bytes([7]) + b"a/msg/\xff", b"\x08a/msg/Bc"])
def test_a_body_that_ends_within_the_name_or_its_padding_is_refused(body: bytes) -> None:
    with pytest.raises(Refused, match="type_name"):
        parse_typed(body)


def test_padding_is_ignored() -> None:
    body = bytearray(pack_typed("a_1/msg/B", CDR))
    body[10:16] = b"\xff" * 6
    assert parse_typed(body) == ("a_1/msg/B", 16)


def test_the_vector_is_packed_from_its_cdr() -> None:
    (datagram,) = load("magnetic-field").datagrams
    message = Reassembler().receive(datagram, "", 0)
    assert message is not None
    typed = parse_typed(message.body)
    assert typed == (MAGNETIC, 32)
    assert pack_typed(MAGNETIC, message.body[32:]) == message.body
    assert message.body[32:36] == b"\x00\x01\x00\x00"
