# SPDX-License-Identifier: Apache-2.0
"""Keyboard driving: velocity commands from key presses. Keys and wall time are arguments.

Terminals do not report key releases, so a command ends half a second after the last key.
"""

from collections.abc import Iterator

DEAD_MAN_SECONDS = 0.5

FASTER = 1.1
"""Change of speed for one key press."""

ARROWS = {b"\x1b[A": "w", b"\x1b[B": "s", b"\x1b[C": "d", b"\x1b[D": "a"}
"""Arrow keys (ECMA-48 CUU, CUD, CUF, CUB) as letters."""


def keys(typed: bytes) -> Iterator[str]:
    """Yield the keys of a terminal's bytes; skip other escape sequences."""
    while typed:
        if typed[:1] == b"\x1b":
            sequence, typed = typed[:3], typed[3:]
            if sequence in ARROWS:
                yield ARROWS[sequence]
        else:
            yield chr(typed[0]).lower()
            typed = typed[1:]


class Keyboard:
    """The commanded velocity.

    Parameters
    ----------
    speed_mps, turn_radps
        initial speed and turn rate.
    max_mps
        top speed of the vehicle.
    """

    help = "w a s d or arrows: drive, space: stop, + -: speed, ] [: turn rate, q: quit"
    """How to drive, in one line."""

    def __init__(self, *, speed_mps: float = 0.5, turn_radps: float = 0.8, max_mps: float) -> None:
        self._max_mps = max_mps
        self.speed_mps = min(speed_mps, max_mps)
        self.turn_radps = turn_radps
        self._ahead = self._left = 0
        self._pressed_seconds = -DEAD_MAN_SECONDS

    def read(self, data: bytes, now_seconds: float) -> bool:
        """Process typed bytes; return whether to continue."""
        for key in keys(data):
            if key == "q":
                return False
            self.pressed(key, now_seconds)
        return True

    def pressed(self, key: str, now_seconds: float) -> None:
        """Process a key; ignore unknown keys."""
        if key in "ws":
            self._ahead, self._left = (1 if key == "w" else -1), 0
        elif key in "ad":
            self._left = 1 if key == "a" else -1
            if self._is_over(now_seconds):
                self._ahead = 0
        elif key == " ":
            self._ahead = self._left = 0
        elif key in "+=":
            self.speed_mps = min(self.speed_mps * FASTER, self._max_mps)
        elif key == "-":
            self.speed_mps /= FASTER
        elif key == "]":
            self.turn_radps *= FASTER
        elif key == "[":
            self.turn_radps /= FASTER
        else:
            return
        if key in "wasd ":
            self._pressed_seconds = now_seconds

    def twist(self, now_seconds: float) -> tuple[float, float]:
        """Return the commanded velocity: m/s forward, rad/s to the left."""
        if self._is_over(now_seconds):
            self._ahead = self._left = 0
        return self._ahead * self.speed_mps, self._left * self.turn_radps

    def _is_over(self, now_seconds: float) -> bool:
        return now_seconds - self._pressed_seconds > DEAD_MAN_SECONDS
