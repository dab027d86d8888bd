# SPDX-License-Identifier: Apache-2.0
"""Joystick driving: velocity commands from the events of Linux's joystick interface.

Bytes are arguments. An event has 8 bytes: milliseconds (uint32), value (int16), type and number
(uint8), in the byte order of the machine (Documentation/input/joydev/joystick-api.rst of Linux).
A joystick tells changes only, so a stick that is held keeps its command.
"""

import struct

EVENT = struct.Struct("=IhBB")

BUTTON, AXIS = 0x01, 0x02

INITIAL = 0x80
"""Bit of an event's type: state at the opening of the device, not a change."""

FULL = 32767
"""Value of an axis at its end."""

DEAD_ZONE = 0.1
"""Share of an axis around its center that commands nothing."""

TURN_AXIS, SPEED_AXIS = 0, 1
"""Left stick: right and down are positive."""

ENABLE_BUTTON = 4
"""Left shoulder button of common gamepads."""


class Joystick:
    """The commanded velocity.

    Parameters
    ----------
    speed_mps, turn_radps
        speed and turn rate at the ends of the axes.
    max_mps
        top speed of the vehicle.
    enable_button
        number of the button that is held to drive; without it the vehicle stops.
    """

    def __init__(
        self,
        *,
        speed_mps: float = 0.5,
        turn_radps: float = 0.8,
        max_mps: float,
        enable_button: int = ENABLE_BUTTON,
    ) -> None:
        self.speed_mps = min(speed_mps, max_mps)
        self.turn_radps = turn_radps
        self._enable_button = enable_button
        self._axes = {TURN_AXIS: 0.0, SPEED_AXIS: 0.0}
        self._is_enabled = False
        self._rest = b""

    @property
    def help(self) -> str:
        """How to drive, in one line."""
        return f"hold button {self._enable_button} and use the left stick to drive, Ctrl-C: quit"

    def read(self, data: bytes, now_seconds: float) -> bool:
        """Take bytes of the device; return whether to continue."""
        data = self._rest + data
        end = len(data) - len(data) % EVENT.size
        self._rest = data[end:]
        for _, value, kind, number in EVENT.iter_unpack(data[:end]):
            if kind & ~INITIAL == AXIS and number in self._axes:
                self._axes[number] = _without_dead_zone(max(value / FULL, -1.0))
            elif kind & ~INITIAL == BUTTON and number == self._enable_button:
                self._is_enabled = value != 0
        return True

    def twist(self, now_seconds: float) -> tuple[float, float]:
        """Return the commanded velocity: m/s forward, rad/s to the left."""
        if not self._is_enabled:
            return 0.0, 0.0
        return (
            0.0 - self._axes[SPEED_AXIS] * self.speed_mps,
            0.0 - self._axes[TURN_AXIS] * self.turn_radps,
        )


def _without_dead_zone(share: float) -> float:
    """Return the deflection beyond the dead zone, scaled so that the end of the axis stays 1."""
    beyond = max(abs(share) - DEAD_ZONE, 0.0) / (1.0 - DEAD_ZONE)
    return beyond if share > 0 else -beyond
