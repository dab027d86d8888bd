# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math

import pytest

from udp_bridge import BadMessage, Refused, control
from udp_bridge.control import NO_AGE, Credit, LinkReport, Subscribe, TopicReport

BODIES: list[tuple[control.Control, str]] = [
    (
        Credit(msg_type=1, part_number=26, seq_number=0x01020304, receive_buffer=212992),
        "00 01 1a 00  04 03 02 01  00 40 03 00",
    ),
    (
        TopicReport(
            msg_type=2,
            messages=400,
            missing=3,
            incomplete=1,
            late=2,
            duplicates=5,
            first_stamp_nanos=1,
            last_stamp_nanos=-1,
            age_nanos=NO_AGE,
        ),
        "01 02 00 00 00 00 00 00"
        "90 01 00 00 00 00 00 00  03 00 00 00 00 00 00 00  01 00 00 00 00 00 00 00"
        "02 00 00 00 00 00 00 00  05 00 00 00 00 00 00 00"
        "01 00 00 00 00 00 00 00  ff ff ff ff ff ff ff ff  00 00 00 00 00 00 00 80",
    ),
    (
        LinkReport(
            receive_buffer=8 << 20, datagrams=7, bytes_received=4660, refused=2, kernel_drops=1
        ),
        "02 00 00 00  00 00 80 00"
        "07 00 00 00 00 00 00 00  34 12 00 00 00 00 00 00"
        "02 00 00 00 00 00 00 00  01 00 00 00 00 00 00 00",
    ),
]


@pytest.mark.parametrize(("value", "text"), BODIES, ids=["Credit", "TopicReport", "LinkReport"])
def test_control_bodies_to_the_byte(value: control.Control, text: str) -> None:
    body = bytes.fromhex(text)
    assert value.pack() == body
    assert control.parse(memoryview(body)) == value
    for wrong in (body[:-1], body + b"\0", body[:1]):
        with pytest.raises(Refused, match="body_size"):
            control.parse(wrong)


def test_reserved_bytes_are_ignored_when_received() -> None:
    body = bytearray(BODIES[0][0].pack())
    body[3] = 0xFF
    assert control.parse(body) == BODIES[0][0]


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        (b"", "body_size"),
        (b"\x03" + bytes(11), "body_value"),
        (b"\xff", "body_value"),
        (b"\x00\x00" + bytes(10), "body_value"),
        (b"\x01\x1f" + bytes(70), "body_value"),
    ],
)
def test_bad_control_is_refused(body: bytes, reason: str) -> None:
    with pytest.raises(Refused) as refused:
        control.parse(body)
    assert refused.value.reason == reason


@pytest.mark.parametrize(
    ("subscribe", "text"),
    [
        (Subscribe(9, 1, 5, 10.0), "09 01 05 00 00 00 20 41"),
        (Subscribe(9, 0), "09 00 00 00 00 00 00 00"),
        (Subscribe(1, 1, 65535, 0.0), "01 01 ff ff 00 00 00 00"),
    ],
)
def test_subscribe_to_the_byte(subscribe: Subscribe, text: str) -> None:
    body = bytes.fromhex(text)
    assert subscribe.pack() == body
    assert Subscribe.parse(body) == subscribe


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("09 01 05 00 00 00 20", "body_size"),
        ("", "body_size"),
        ("1f 01 00 00 00 00 00 00", "body_value"),
        ("07 01 00 00 00 00 00 00", "body_value"),
        ("09 02 00 00 00 00 00 00", "body_value"),
        ("09 01 00 00 00 00 80 bf", "body_value"),
        ("09 01 00 00 00 00 c0 7f", "body_value"),
        ("09 01 00 00 00 00 80 7f", "body_value"),
    ],
)
def test_bad_subscribe_is_refused(body: str, reason: str) -> None:
    with pytest.raises(Refused) as refused:
        Subscribe.parse(bytes.fromhex(body))
    assert refused.value.reason == reason


@pytest.mark.parametrize(
    "subscribe",
    [Subscribe(64), Subscribe(9, 2), Subscribe(9, 1, -1), Subscribe(9, 1, 0, math.inf)],
)
def test_what_no_peer_takes_is_not_packed(subscribe: Subscribe) -> None:
    with pytest.raises(BadMessage):
        subscribe.pack()
