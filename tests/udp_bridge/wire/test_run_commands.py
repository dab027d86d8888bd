# SPDX-License-Identifier: Apache-2.0
import pytest
from hypothesis import given
from hypothesis import strategies as st

from udp_bridge import BadMessage, Refused
from udp_bridge.wire import control
from udp_bridge.wire.run_commands import (
    ERROR_BYTES,
    PAUSE,
    PAUSED,
    QUERY,
    RESET,
    RUNNING,
    STEP,
    STOPPED,
    RunCommand,
    RunCommandReply,
)

BODIES = [
    (
        RunCommand(0x0102030405060708, STEP, 400),
        "06 03 00 00  90 01 00 00  08 07 06 05 04 03 02 01",
    ),
    (RunCommand(1, RESET), "06 04 00 00  00 00 00 00  01 00 00 00 00 00 00 00"),
    (
        RunCommandReply(7, PAUSED, 800),
        "07 02 00 00 00 00 00 00  07 00 00 00 00 00 00 00  20 03 00 00 00 00 00 00",
    ),
    (
        RunCommandReply(7, STOPPED, -1, "no run"),
        "07 00 00 00 00 00 00 00  07 00 00 00 00 00 00 00  ff ff ff ff ff ff ff ff"
        "6e 6f 20 72 75 6e",
    ),
]


@pytest.mark.parametrize(("value", "text"), BODIES, ids=["step", "reset", "done", "failed"])
def test_bodies_to_the_byte(value: RunCommand | RunCommandReply, text: str) -> None:
    body = bytes.fromhex(text)
    assert value.pack() == body
    assert control.parse(memoryview(body)) == value
    with pytest.raises(Refused, match="body_size"):
        control.parse(body[:15])


NUMBERS = st.integers(0, 2**64 - 1)
COMMANDS = st.builds(
    RunCommand, NUMBERS, st.sampled_from([QUERY, PAUSE, RESET]), st.just(0)
) | st.builds(RunCommand, NUMBERS, st.just(STEP), st.integers(1, 2**32 - 1))
TEXTS = st.text(st.characters(blacklist_categories=["Cs"], blacklist_characters="\0"), max_size=200)
ANSWERS = st.builds(
    RunCommandReply,
    NUMBERS,
    st.sampled_from([STOPPED, RUNNING, PAUSED]),
    st.integers(-1, 2**63 - 1),
    TEXTS,
)


@given(COMMANDS | ANSWERS)
def test_what_is_packed_is_parsed(value: RunCommand | RunCommandReply) -> None:
    assert control.parse(value.pack()) == value


@given(st.sampled_from([6, 7]), st.binary(max_size=60))
def test_any_bytes_are_refused_or_mean_the_same_when_packed_again(kind: int, rest: bytes) -> None:
    body = bytes([kind]) + rest
    try:
        value = control.parse(body)
    except Refused:
        return
    assert control.parse(value.pack()) == value


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("06 05 00 00  00 00 00 00  01 00 00 00 00 00 00 00", "body_value"),  # no such command
        ("06 03 00 00  00 00 00 00  01 00 00 00 00 00 00 00", "body_value"),  # a step of nothing
        ("06 01 00 00  01 00 00 00  01 00 00 00 00 00 00 00", "body_value"),  # a pause of a tick
        ("06 01 00 00  00 00 00 00  01 00 00 00 00 00 00 00 00", "body_size"),
        ("07 03" + 22 * " 00", "body_value"),  # no such state
        ("07 01" + 20 * " 00" + " 00 80", "body_value"),  # no such tick
        ("07 01" + 22 * " 00" + " 00", "body_value"),  # NUL
        ("07 01" + 22 * " 00" + " ff", "body_value"),  # no UTF-8
        ("07 01" + (22 + ERROR_BYTES) * " 00" + " 61", "body_size"),
    ],
)
def test_bad_bodies_are_refused(body: str, reason: str) -> None:
    with pytest.raises(Refused, match=reason):
        control.parse(bytes.fromhex(body))


@pytest.mark.parametrize(
    "value",
    [
        RunCommand(1, 5),
        RunCommand(1, STEP),
        RunCommand(1, PAUSE, 1),
        RunCommandReply(1, 3, 0),
        RunCommandReply(1, RUNNING, -2),
        RunCommandReply(1, RUNNING, 0, "x" * (ERROR_BYTES + 1)),
    ],
)
def test_what_no_peer_takes_is_not_packed(value: RunCommand | RunCommandReply) -> None:
    with pytest.raises(BadMessage):
        value.pack()
