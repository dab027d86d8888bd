# SPDX-License-Identifier: Apache-2.0
import pytest

from udp_bridge import BadMessage, Link
from udp_bridge.sender.repair import Fec, Mode, Resend, check_table, parse_mode
from udp_bridge.wire import fec


@pytest.mark.parametrize(
    ("said", "mode"),
    [
        (None, None),
        ("none", None),
        ("resend", Resend(500_000_000)),
        ({"resend": 0.2}, Resend(200_000_000)),
        ({"resend": 2}, Resend(2_000_000_000)),
        ({"fec": 0.2}, Fec(0.2)),
        ({"fec": 1}, Fec(1.0)),
    ],
)
def test_modes_that_users_write(said: object, mode: Mode | None) -> None:
    assert parse_mode(said) == mode


@pytest.mark.parametrize(
    "said",
    ["fec", "all", 3, {}, {"fec": 0}, {"fec": 1.5}, {"fec": True}, {"resend": 0}, {"resend": 61},
     {"fec": float("nan")}, {"fec": 0.1, "resend": 1}, {"rs": 0.2}],
)  # fmt: skip
def test_invalid_mode_gives_one_line(said: object) -> None:
    with pytest.raises(BadMessage, match="is neither none, resend") as error:
        parse_mode(said)
    assert "\n" not in str(error.value)


def test_fec_without_its_library_is_refused_at_the_sender(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fec, "is_available", lambda: False)
    with pytest.raises(BadMessage, match=r"repair of '/points' by fec needs the package raptorq"):
        Link(("127.0.0.1", 0), repair={(1, "/points"): Fec(0.2)})
    assert check_table({(1, "/points"): Resend(1)}) == {(1, "/points"): Resend(1)}
    assert check_table(None) == {}
