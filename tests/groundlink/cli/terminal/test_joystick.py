# SPDX-License-Identifier: Apache-2.0
"""Events of a joystick become velocities, only while the enabling button is held."""

import struct

import pytest

from groundlink.cli.terminal.joystick import Joystick

HELD = (1, 0x01, 4)
RELEASED = (0, 0x01, 4)


def events(*told: tuple[int, int, int]) -> bytes:
    """Return the bytes of events: value, type, number."""
    return b"".join(struct.pack("=IhBB", 1000 + i, *event) for i, event in enumerate(told))


def driven(*told: tuple[int, int, int]) -> tuple[float, float]:
    stick = Joystick(speed_mps=0.5, turn_radps=0.8, max_mps=1.5)
    assert stick.read(events(*told), 0.0)
    return stick.twist(0.0)


@pytest.mark.parametrize(
    ("told", "twist"),
    [
        ([HELD, (-32767, 0x02, 1)], (0.5, 0.0)),
        ([HELD, (32767, 0x02, 1)], (-0.5, 0.0)),
        ([HELD, (-32768, 0x02, 1)], (0.5, 0.0)),
        ([HELD, (-32767, 0x02, 0)], (0.0, 0.8)),
        ([HELD, (32767, 0x02, 0), (-32767, 0x02, 1)], (0.5, -0.8)),
        ([HELD, (-18022, 0x02, 1)], (0.25, 0.0)),  # halfway from the dead zone to the end
        ([HELD, (-3276, 0x02, 1), (3276, 0x02, 0)], (0.0, 0.0)),  # in the dead zone
        ([HELD, (-32767, 0x02, 1), (0, 0x02, 1)], (0.0, 0.0)),
        ([(-32767, 0x02, 1)], (0.0, 0.0)),  # without the button
        ([HELD, (-32767, 0x02, 1), RELEASED], (0.0, 0.0)),
        ([(-32767, 0x02, 1), (1, 0x01, 5)], (0.0, 0.0)),  # another button
        ([HELD, (-32767, 0x02, 3)], (0.0, 0.0)),  # another axis
        ([(1, 0x81, 4), (-32767, 0x82, 1)], (0.5, 0.0)),  # the state at the opening
    ],
)
def test_events_command_a_velocity(
    told: list[tuple[int, int, int]], twist: tuple[float, float]
) -> None:
    assert driven(*told) == pytest.approx(twist, abs=1e-4)


def test_top_speed_of_the_vehicle_is_the_limit() -> None:
    stick = Joystick(speed_mps=9.0, max_mps=1.5)
    stick.read(events(HELD, (-32767, 0x02, 1)), 0.0)
    assert stick.twist(0.0)[0] == 1.5


def test_another_button_enables() -> None:
    stick = Joystick(max_mps=1.5, enable_button=7)
    stick.read(events((1, 0x01, 7), (-32767, 0x02, 1)), 0.0)
    assert stick.twist(0.0)[0] == 0.5


def test_bytes_may_come_in_any_parts() -> None:
    whole, parts = Joystick(max_mps=1.5), Joystick(max_mps=1.5)
    data = events(HELD, (-20000, 0x02, 1), (9000, 0x02, 0))
    whole.read(data, 0.0)
    for byte in data:
        parts.read(bytes([byte]), 0.0)
    assert parts.twist(0.0) == whole.twist(0.0) != (0.0, 0.0)
