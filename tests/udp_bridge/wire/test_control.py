# SPDX-License-Identifier: Apache-2.0
import math

import pytest

from udp_bridge import BadMessage, Refused
from udp_bridge.wire import control
from udp_bridge.wire.control import (
    NO_AGE,
    Credit,
    CreditRequest,
    LinkReport,
    Subscribe,
    TopicReport,
)

BODIES: list[tuple[control.Control, str]] = [
    (
        Credit(msg_type=1, part_number=26, seq_number=0x01020304, receive_buffer=212992),
        "00 01 1a 00  04 03 02 01  00 40 03 00",
    ),
    (
        TopicReport(
            msg_type=2,
            first_number=0x01020304,
            since_nanos=7,
            numbers=400,
            published=300,
            dropped=20,
            incomplete=10,
            late=6,
            pending=5,
            repaired=4,
            duplicates=3,
            body_bytes=0x11223344,
            first_seen_stamp_nanos=1,
            first_stamp_nanos=2,
            last_stamp_nanos=-1,
            age_p50_nanos=9,
            age_p99_nanos=NO_AGE,
        ),
        "01 02 00 00 04 03 02 01  07 00 00 00 00 00 00 00"
        "90 01 00 00 00 00 00 00  2c 01 00 00 00 00 00 00  14 00 00 00 00 00 00 00"
        "0a 00 00 00 00 00 00 00  06 00 00 00 00 00 00 00  05 00 00 00 00 00 00 00"
        "04 00 00 00 00 00 00 00  03 00 00 00 00 00 00 00  44 33 22 11 00 00 00 00"
        "01 00 00 00 00 00 00 00  02 00 00 00 00 00 00 00  ff ff ff ff ff ff ff ff"
        "09 00 00 00 00 00 00 00  00 00 00 00 00 00 00 80",
    ),
    (
        LinkReport(
            receive_buffer=8 << 20,
            datagrams=7,
            bytes_received=4660,
            refused=3,
            kernel_drops=1,
            reasons=(("short", 2), ("link", 1)),
        ),
        "02 00 00 00  00 00 80 00"
        "07 00 00 00 00 00 00 00  34 12 00 00 00 00 00 00"
        "03 00 00 00 00 00 00 00  01 00 00 00 00 00 00 00"
        "02 00 00 00 00 00 00 00  05  73 68 6f 72 74"
        "01 00 00 00 00 00 00 00  04  6c 69 6e 6b",
    ),
    (CreditRequest(), "03 00 00 00"),
]


@pytest.mark.parametrize(
    ("value", "text"), BODIES, ids=["Credit", "TopicReport", "LinkReport", "CreditRequest"]
)
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
        (b"\x0c" + bytes(11), "body_value"),
        (b"\xff", "body_value"),
        (b"\x00\x00" + bytes(10), "body_value"),
        (b"\x01\x1f" + bytes(126), "body_value"),
        (TopicReport(*[1, 0, 0, 5, 6, *[0] * 12]).pack(), "body_value"),  # more than there are
        (LinkReport(1, 2, 3, 4, 5, (("Bad", 1),)).pack(), "body_value"),
        (LinkReport(1, 2, 3, 4, 5, (("", 1),)).pack(), "body_value"),
        (LinkReport(1, 2, 3, 4, 5, (("a", 1),) * 33).pack(), "body_size"),
    ],
)
def test_bad_control_is_refused(body: bytes, reason: str) -> None:
    with pytest.raises(Refused, match=rf"^{reason}$"):
        control.parse(body)


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
    with pytest.raises(Refused, match=rf"^{reason}$"):
        Subscribe.parse(bytes.fromhex(body))


@pytest.mark.parametrize(
    "subscribe",
    [Subscribe(64), Subscribe(9, 2), Subscribe(9, 1, -1), Subscribe(9, 1, 0, math.inf)],
)
def test_what_no_peer_takes_is_not_packed(subscribe: Subscribe) -> None:
    with pytest.raises(BadMessage):
        subscribe.pack()


def test_link_report_has_the_most_frequent_reasons() -> None:
    refused = {f"reason_{number}": number for number in range(1, 41)}
    report = LinkReport.of(1, 2, 3, 4, refused)
    assert report.refused == 820
    assert report.reasons[:2] == (("reason_40", 40), ("reason_39", 39))
    assert len(report.reasons) == 32
    assert control.parse(report.pack()) == report
