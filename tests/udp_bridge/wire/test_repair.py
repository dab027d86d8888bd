# SPDX-License-Identifier: Apache-2.0
import pytest
from hypothesis import given
from hypothesis import strategies as st

from udp_bridge.wire.header import Refused
from udp_bridge.wire.repair import Offer, Request, Symbol, parse_resend, parse_symbol

OFFER = bytes.fromhex("00 01 40 00 f4 01 00 00")
REQUEST = bytes.fromhex("01 01 0a 01 40 42 0f 00 05 02")
WHOLE = bytes.fromhex("01 02 00 07 00 00 00 00")
SYMBOL = bytes.fromhex("01 02 01 00 1c 00 00 00") + bytes(range(16))


def test_bytes_of_each_body() -> None:
    assert Offer(1, 64, 500).pack() == OFFER
    assert Request(1, 10, 1, 1_000_000, (0, 2, 9)).pack() == REQUEST
    assert Request(2, 0, 7, 0).pack() == WHOLE
    assert Symbol(1, 2, 1, 28).pack() == SYMBOL[:8]


def test_bodies_come_back() -> None:
    assert parse_resend(OFFER) == Offer(1, 64, 500)
    assert parse_resend(REQUEST) == Request(1, 10, 1, 1_000_000, (0, 2, 9))
    assert parse_resend(memoryview(WHOLE)) == Request(2, 0, 7, 0)
    symbol, data = parse_symbol(memoryview(SYMBOL))
    assert symbol == Symbol(1, 2, 1, 28)
    assert bytes(data) == bytes(range(16))


@given(st.integers(1, 255).flatmap(lambda n: st.tuples(st.just(n), st.sets(st.integers(0, n - 1)))))
def test_any_parts_come_back(case: tuple[int, set[int]]) -> None:
    parts_max, parts = case
    request = Request(33, parts_max, 1, 7, tuple(sorted(parts or {0})))
    assert parse_resend(request.pack()) == request


def changed(body: bytes, at: int, value: int) -> bytes:
    return body[:at] + bytes([value]) + body[at + 1 :]


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        (b"", "body_size"),
        (OFFER[:7], "body_size"),
        (OFFER + b"\0", "body_size"),
        (REQUEST[:-1], "body_size"),
        (REQUEST + b"\0", "body_size"),
        (WHOLE + b"\1", "body_size"),
        (changed(OFFER, 0, 2), "body_value"),
        (changed(OFFER, 1, 64), "body_value"),  # the bridge's own are not repaired
        (changed(OFFER, 1, 200), "body_value"),
        (changed(OFFER, 2, 0), "body_value"),
        (changed(REQUEST, 3, 0), "body_value"),
        (changed(REQUEST, 3, 2), "body_value"),
        (changed(REQUEST, 9, 4), "body_value"),  # part 10 of 10
        (REQUEST[:8] + b"\0\0", "body_value"),
        (changed(WHOLE, 3, 0), "body_value"),
        (changed(WHOLE, 3, 65), "body_value"),
    ],
)
def test_wrong_resend_bodies_are_refused(body: bytes, reason: str) -> None:
    with pytest.raises(Refused, match=rf"^{reason}$"):
        parse_resend(body)


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        (b"", "body_size"),
        (SYMBOL[:8], "body_size"),
        (SYMBOL[:-1], "body_size"),
        (changed(SYMBOL, 0, 66), "body_value"),
        (changed(SYMBOL, 1, 3), "body_value"),
        (changed(SYMBOL, 4, 33), "body_value"),  # 33 bytes are three symbols of 16
        (changed(changed(SYMBOL, 4, 0), 1, 0), "body_value"),
    ],
)
def test_wrong_symbols_are_refused(body: bytes, reason: str) -> None:
    with pytest.raises(Refused, match=rf"^{reason}$"):
        parse_symbol(body)
