# SPDX-License-Identifier: Apache-2.0
"""Keys become velocities, and end by themselves."""

import pytest

from groundlink.cli.terminal.keyboard import DEAD_MAN_SECONDS, Keyboard, keys

SOON, LATE = 0.9 * DEAD_MAN_SECONDS, 1.1 * DEAD_MAN_SECONDS


@pytest.fixture
def board() -> Keyboard:
    return Keyboard(speed_mps=0.5, turn_radps=0.8, max_mps=1.5)


@pytest.mark.parametrize(
    ("typed", "expected"),
    [
        (b"wA", ["w", "a"]),
        (b"\x1b[A\x1b[B\x1b[C\x1b[D", ["w", "s", "d", "a"]),
        (b"\x1b[Hw", ["w"]),
        (b"\x1b", []),
        (b" +", [" ", "+"]),
        (bytes(range(128, 256)), [chr(i).lower() for i in range(128, 256)]),
    ],
)
def test_bytes_become_keys(typed: bytes, expected: list[str]) -> None:
    assert list(keys(typed)) == expected


@pytest.mark.parametrize(
    ("pressed", "twist"),
    [
        ("", (0.0, 0.0)),
        ("w", (0.5, 0.0)),
        ("s", (-0.5, 0.0)),
        ("a", (0.0, 0.8)),
        ("d", (0.0, -0.8)),
        ("wa", (0.5, 0.8)),
        ("sd", (-0.5, -0.8)),
        ("waw", (0.5, 0.0)),
        ("wa ", (0.0, 0.0)),
        ("w+", (0.55, 0.0)),
        ("w-", (0.5 / 1.1, 0.0)),
        ("a]", (0.0, 0.88)),
        ("a[", (0.0, 0.8 / 1.1)),
        ("wz", (0.5, 0.0)),
        ("w" + 40 * "+", (1.5, 0.0)),
    ],
)
def test_each_key_commands_its_velocity(
    board: Keyboard, pressed: str, twist: tuple[float, float]
) -> None:
    for key in pressed:
        board.pressed(key, 0.0)
    assert board.twist(0.1) == pytest.approx(twist)


def test_who_lets_go_stops(board: Keyboard) -> None:
    board.pressed("w", 0.0)
    assert board.twist(SOON)[0] == 0.5
    board.pressed("w", SOON)
    assert board.twist(SOON + SOON)[0] == 0.5
    assert board.twist(SOON + LATE) == (0.0, 0.0)
    assert board.twist(SOON) == (0.0, 0.0), "it begins again by itself"


def test_a_key_for_speed_or_an_unknown_one_does_not_go_on_driving(board: Keyboard) -> None:
    board.pressed("w", 0.0)
    for key in "+]z":
        board.pressed(key, SOON)
    assert board.twist(LATE) == (0.0, 0.0)


def test_a_turn_after_a_pause_is_on_the_spot(board: Keyboard) -> None:
    board.pressed("w", 0.0)
    board.pressed("a", LATE)
    assert board.twist(LATE) == (0.0, 0.8)
