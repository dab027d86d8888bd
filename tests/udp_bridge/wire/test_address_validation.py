# SPDX-License-Identifier: Apache-2.0
import json
from typing import Any

import pytest

from tests.udp_bridge.vectors import FOLDER
from udp_bridge import Header, Refused
from udp_bridge.wire import address_validation, control
from udp_bridge.wire.address_validation import AddressChallenge, AddressResponse, AddressValidator
from udp_bridge.wire.types import CONTROL

SECOND = 10**9
HERE = ("192.0.2.1", 7510)
VECTOR: dict[str, Any] = json.loads((FOLDER / "control/address-validation.json").read_text())


@pytest.fixture
def validator() -> AddressValidator:
    return AddressValidator(b"key")


def validated(validator: AddressValidator, address: tuple[str, int], now_nanos: int) -> bool:
    return validator.respond(address, validator.cookie(address, now_nanos), now_nanos)


@pytest.mark.parametrize("row", VECTOR["cookies"])
def test_vectors(row: dict[str, Any]) -> None:
    address = (row["host"], row["port"])
    validator = AddressValidator(bytes.fromhex(VECTOR["key"]))
    cookie = validator.cookie(address, row["clock_ms"] * 1_000_000)
    assert cookie.hex() == row["cookie"]
    head = Header(CONTROL, 0, 0, 1, 0, 0).pack()
    for kind, of in (("challenge", AddressChallenge), ("response", AddressResponse)):
        assert (head + of(cookie).pack()).hex() == row[kind]
        assert control.parse(bytes.fromhex(row[kind])[len(head) :]) == of(cookie)


def test_another_size_is_refused() -> None:
    body = AddressChallenge(bytes(12)).pack()
    for wrong in (body[:-1], body + b"\0"):
        with pytest.raises(Refused, match="body_size"):
            control.parse(wrong)


def test_cookie_validates_its_address_within_its_time(validator: AddressValidator) -> None:
    cookie = validator.cookie(HERE, 0)
    assert not validator.respond(("192.0.2.2", 7510), cookie, 0)
    assert not validator.respond(("192.0.2.1", 7511), cookie, 0)
    assert not validator.respond(HERE, bytes(12), 0)
    assert not validator.respond(HERE, cookie, 11 * SECOND)
    assert not AddressValidator(b"another").respond(HERE, cookie, 0)
    assert not validator.is_validated(HERE, 0)
    assert validator.respond(HERE, cookie, 9 * SECOND)
    assert validator.is_validated(HERE, 68 * SECOND)
    assert not validator.is_validated(HERE, 69 * SECOND)


def test_the_clock_in_a_cookie_wraps(validator: AddressValidator) -> None:
    before = (2**32 - 1) * 1_000_000
    assert validator.respond(HERE, validator.cookie(HERE, before), before + SECOND)


def test_a_validation_is_renewed_before_it_ends(validator: AddressValidator) -> None:
    assert not validator.is_renewal_due(HERE, 0)
    assert validated(validator, HERE, 0)
    assert not validator.is_renewal_due(HERE, 19 * SECOND)
    assert validator.is_renewal_due(HERE, 20 * SECOND)
    assert not validator.is_renewal_due(HERE, 20 * SECOND + 1)
    assert validator.is_renewal_due(HERE, 21 * SECOND)
    assert validated(validator, HERE, 22 * SECOND)
    assert not validator.is_renewal_due(HERE, 41 * SECOND)


def test_unvalidated_address_gets_no_more_bytes_than_received(validator: AddressValidator) -> None:
    assert not validator.spend(HERE, 1)
    validator.received(HERE, 100)
    assert validator.spend(HERE, 60)
    assert not validator.spend(HERE, 41)
    assert validator.spend(HERE, 40)
    assert validator.unsent(HERE) == 0


def test_tables_are_bounded_and_active_addresses_stay(
    validator: AddressValidator, monkeypatch: pytest.MonkeyPatch
) -> None:
    for port in range(2000):
        validator.received(("192.0.2.1", port), 10)
    assert validator.unsent(("192.0.2.1", 0)) == 0
    assert validator.unsent(("192.0.2.1", 1999)) == 10
    assert [validated(validator, ("192.0.2.1", port), 0) for port in range(9)] == [True] * 8 + [
        False
    ]
    monkeypatch.setattr(address_validation, "VALIDATED_MAX", 9)
    assert validated(validator, ("192.0.2.2", 1), 0)
    assert not validated(validator, ("192.0.2.3", 1), 0)
    assert validated(validator, ("192.0.2.1", 0), 50 * SECOND)
    assert validated(validator, ("192.0.2.3", 1), 61 * SECOND)
    assert validator.is_validated(("192.0.2.1", 0), 61 * SECOND)


def test_loopback_needs_no_validation(validator: AddressValidator) -> None:
    assert validator.is_validated(("127.0.0.1", 1), 0)
