# SPDX-License-Identifier: Apache-2.0
import pytest
from hypothesis import given
from hypothesis import strategies as st

from udp_bridge import MSG_TYPES, BadMessage, Refused
from udp_bridge.wire import control
from udp_bridge.wire.lockstep import (
    DONE,
    INCOMPLETE,
    JOINED,
    RESTARTED,
    WAITING,
    Barrier,
    BarrierReply,
    ExpectedResponse,
    SentMessages,
)

BARRIER = Barrier(
    episode=0x0102030405060708,
    tick=800,
    limit_ms=2000,
    sent=(SentMessages(36, "/odom", 7, 2), SentMessages(8, "/clock", 0xFFFFFFFF, 1)),
    responses=(ExpectedResponse("/cmd_vel", "/odom", 9), ExpectedResponse("/ready", "/clock")),
)
BARRIER_BYTES = bytes.fromhex(
    "04 02 02 00  d0 07 00 00  08 07 06 05 04 03 02 01  20 03 00 00 00 00 00 00"
    "24 05 02 00  07 00 00 00  2f 6f 64 6f 6d"
    "08 06 01 00  ff ff ff ff  2f 63 6c 6f 63 6b"
    "09 08 05 00  2f 63 6d 64 5f 76 65 6c  2f 6f 64 6f 6d"
    "00 06 06 00  2f 72 65 61 64 79  2f 63 6c 6f 63 6b"
)
IN_TURN = Barrier(
    episode=1,
    tick=0,
    limit_ms=0,
    responses=(
        ExpectedResponse("/path", "/scan", 0, 2),
        ExpectedResponse("/cmd_vel", "/path", 9, JOINED),
    ),
    in_turn=True,
)
IN_TURN_BYTES = bytes.fromhex(
    "04 00 02 01  00 00 00 00  01 00 00 00 00 00 00 00  00 00 00 00 00 00 00 00"
    "00 05 05 02  2f 70 61 74 68  2f 73 63 61 6e"
    "09 08 05 ff  2f 63 6d 64 5f 76 65 6c  2f 70 61 74 68"
)
REPLY = BarrierReply(
    episode=1, tick=-1, state=WAITING, lost=3, sent=(SentMessages(9, "/cmd_vel", 5, 0xFFFF),)
)
REPLY_BYTES = bytes.fromhex(
    "05 01 01 00  03 00 00 00  01 00 00 00 00 00 00 00  ff ff ff ff ff ff ff ff"
    "09 08 ff ff  05 00 00 00  2f 63 6d 64 5f 76 65 6c"
)


@pytest.mark.parametrize(
    ("value", "body"),
    [(BARRIER, BARRIER_BYTES), (IN_TURN, IN_TURN_BYTES), (REPLY, REPLY_BYTES)],
    ids=["Barrier", "Barrier in turn", "BarrierReply"],
)
def test_bodies_to_the_byte(value: Barrier | BarrierReply, body: bytes) -> None:
    assert value.pack() == body
    assert control.parse(memoryview(body)) == value
    for cut in range(1, len(body)):
        with pytest.raises(Refused, match="body_size"):
            control.parse(body[:cut])
    with pytest.raises(Refused, match="body_size"):
        control.parse(body + b"\0")


DATA = [number for number, row in MSG_TYPES.items() if row.ros_type]
NAMES = st.text(
    st.characters(blacklist_categories=["Cs"], blacklist_characters="\0"), min_size=1, max_size=60
)
SENT = st.builds(
    SentMessages, st.sampled_from(DATA), NAMES, st.integers(0, 2**32 - 1), st.integers(1, 65535)
)
EPISODES, TICKS = st.integers(0, 2**64 - 1), st.integers(-1, 2**63 - 1)
ANSWERS = st.builds(
    ExpectedResponse, NAMES, NAMES, st.sampled_from([0, *DATA]), st.integers(0, JOINED)
)
BARRIERS = st.builds(
    Barrier,
    EPISODES,
    TICKS,
    st.integers(0, 2**32 - 1),
    st.lists(SENT, max_size=5, unique_by=lambda sent: sent[:2]).map(tuple),
    st.lists(ANSWERS, max_size=5).map(tuple),
    st.booleans(),
)
WORDS = st.builds(
    BarrierReply,
    EPISODES,
    TICKS,
    st.sampled_from([DONE, WAITING, INCOMPLETE, RESTARTED]),
    st.integers(0, 2**32 - 1),
    st.lists(SENT, max_size=5, unique_by=lambda sent: sent[:2]).map(tuple),
)


@given(BARRIERS | WORDS)
def test_what_is_packed_is_parsed(value: Barrier | BarrierReply) -> None:
    assert control.parse(value.pack()) == value


@given(st.sampled_from([4, 5]), st.binary(max_size=120))
def test_any_bytes_are_refused_or_mean_the_same_when_packed_again(kind: int, rest: bytes) -> None:
    body = bytes([kind]) + rest
    try:
        value = control.parse(body)
    except Refused:
        return
    assert control.parse(value.pack()) == value


@pytest.mark.parametrize(
    ("body", "at", "byte"),
    [
        (BARRIER_BYTES, 23, 0x80),  # tick far below -1
        (BARRIER_BYTES, 24, 64),  # type of a topic: no ROS type
        (BARRIER_BYTES, 26, 0),  # no messages
        (BARRIER_BYTES, 32, 0),  # NUL in a name
        (BARRIER_BYTES, 33, 0xFF),  # no UTF-8
        (BARRIER_BYTES, 51, 7),  # type of an answer: no ROS type
        (REPLY_BYTES, 2, 4),  # no state
        (REPLY_BYTES, 16, 0xFE),  # tick -2
    ],
)
def test_bad_values_are_refused(body: bytes, at: int, byte: int) -> None:
    wrong = bytearray(body)
    wrong[at] = byte
    with pytest.raises(Refused, match="body_value"):
        control.parse(wrong)


def test_an_empty_name_is_refused() -> None:
    body = BARRIER._replace(sent=(), responses=()).pack()
    for rest in (b"\x24\0\x01\0\0\0\0\0", b"\x09\0\0\0"):
        one = bytearray(body + rest)
        one[1 if len(rest) == 8 else 2] = 1
        with pytest.raises(Refused, match="body_value"):
            control.parse(one)


@pytest.mark.parametrize(
    "value",
    [
        BARRIER._replace(tick=-2),
        BARRIER._replace(responses=(ExpectedResponse("/a", "/b"),) * 256),
        BARRIER._replace(responses=(ExpectedResponse("", "/b"),)),
        BARRIER._replace(sent=(SentMessages(8, "/clock", 0, 1),) * 256),
        BARRIER._replace(sent=(SentMessages(8, "/clock", 0, 1), SentMessages(8, "/clock", 1, 1))),
        BARRIER._replace(sent=(SentMessages(8, "/clock", 0, 0),)),
        REPLY._replace(sent=(SentMessages(9, "/" * 256, 0, 1),)),
        REPLY._replace(sent=(SentMessages(9, "/cmd_vel", 0, 65536),)),
        REPLY._replace(state=4),
        REPLY._replace(tick=-2),
    ],
)
def test_what_no_peer_takes_is_not_packed(value: Barrier | BarrierReply) -> None:
    with pytest.raises(BadMessage):
        value.pack()
